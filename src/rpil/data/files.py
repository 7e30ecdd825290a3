"""Paths of files and folders: checks before reading and writing, and output that is whole or not there.

No link that leads out of a named folder of data is followed, and no pipe or device in it is opened.
"""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rpil.data.errors import DataError

_POINTER = b"version https://git-lfs"
_MOST_OF_POINTER = 1024  # bytes, by the definition of Git LFS

StrPath = str | os.PathLike[str]


def check_extension(path: StrPath, extensions: Collection[str], use: str = "") -> Path:
    """`path`, or a `DataError` naming `extensions`, which fit the `use` of the file, where it has none of them."""
    path = Path(path)
    if path.suffix.lower() not in extensions:
        use = f" for {use}" if use else ""
        raise DataError(f"{path}: unknown extension {path.suffix!r}{use}; use one of {', '.join(extensions)}.")
    return path


def check_exists(path: StrPath) -> Path:
    """`path`, or a `DataError` where it is missing, or is a pipe or device."""
    path = Path(path)
    if not path.exists():
        raise DataError(f"{path}: there is no such file or folder; check the path.")
    if not (path.is_file() or path.is_dir()):  # to open a pipe is to wait for it
        raise DataError(f"{path}: it is neither a file nor a folder; give the path of one.")
    return path


def check_readable(path: StrPath) -> Path:
    """`path`, or a `DataError` where it is missing, a folder, empty or may not be read."""
    path = check_exists(path)
    if path.is_dir():
        raise DataError(f"{path}: it is a folder; give the path of one file.")
    if not os.access(path, os.R_OK):
        raise DataError(f"{path}: it may not be read; change its permissions.")
    if path.stat().st_size == 0:
        raise DataError(f"{path}: the file is empty; write it again.")
    if path.stat().st_size < _MOST_OF_POINTER:
        with path.open("rb") as file:
            refuse_pointer(file.read(len(_POINTER)), path)
    return path


def refuse_pointer(start: bytes, where: StrPath) -> None:
    """A `DataError` where a file that begins with `start` stands for one that Git LFS has not brought yet."""
    if start.startswith(_POINTER):
        raise DataError(f"{where}: it is a pointer of Git LFS and not the data; bring them with git lfs pull.")


def check_writable(path: StrPath) -> Path:
    """`path`, or a `DataError` where it cannot be written: to be called before long work begins."""
    path = Path(path)
    folder = path.parent
    if not folder.is_dir():
        raise DataError(f"{path}: there is no folder {folder}; make it first.")
    if len(os.fsencode(path.name)) > 255:
        raise DataError(f"{path}: its name is longer than 255 bytes; give a shorter one.")
    is_there = os.path.exists(path)  # which a path that is too long is not
    if is_there and not path.is_file():  # to replace /dev/null would break the machine
        raise DataError(f"{path}: it is a folder or a device; give the path of a file.")
    if not os.access(folder, os.W_OK) or (is_there and not os.access(path, os.W_OK)):
        raise DataError(f"{path}: it may not be written; choose another place or change the permissions.")
    return path


@contextmanager
def replacing(path: StrPath) -> Iterator[Path]:
    """Yield a path beside `path` to write to, a file or folder, which replaces `path` if the block ends without error.

    A `DataError` where `path` cannot be written; a file that was there stays as it was, and a file that is replaced
    gives its permissions to the new one.
    """
    # A link stays a link: what it points to is replaced.
    target = Path(os.path.realpath(check_writable(path)))
    temporary = target.with_name(f".{uuid.uuid4().hex}{target.suffix}")  # some writers add their own to a name without
    try:
        if os.path.exists(target):  # only its owner may read the new one until it has the permissions of the old one
            temporary.touch(0o600)
        yield temporary
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    except OSError as error:
        # Libraries put more into the text of the error than what the system says.
        reason = os.strerror(error.errno) if error.errno else type(error).__name__
        raise DataError(f"{path}: it cannot be written ({reason}).") from error
    finally:
        if temporary.is_dir():
            shutil.rmtree(temporary, ignore_errors=True)
        else:
            temporary.unlink(missing_ok=True)


def check_outputs(inputs: Iterable[StrPath | None], outputs: Iterable[StrPath | None]) -> None:
    """A `DataError`, before any work, naming an output that cannot be written, is named twice, or lies in an input."""
    taken = {*(sources := [Path(path).resolve() for path in inputs if path])}
    for path in (path for path in outputs if path is not None):
        place = check_writable(path).resolve()
        if place in taken:
            raise DataError(f"{path}: it is named twice in the command; give every file a name of its own.")
        taken.add(place)
        if inside := [source for source in sources if source in place.parents]:
            raise DataError(f"{path}: it would join the data in {inside[0]}; write it to another folder.")


_DATA = ("data", "meta")
"""The folders that are read where there is ``data``; what lies in others beside it, as videos, may be anything."""


def check_folder(path: StrPath) -> None:
    """A `DataError` where what lies in the folder at `path` must not be followed or opened.

    That is a link that leads out of the folder, to nothing, or to a folder, which would be read twice; and a pipe or
    device, which a reader would wait for. The folder itself may be named by a link. From a snapshot in the cache of the
    Hugging Face Hub, links may lead to the ``blobs`` of its repository. Nothing is checked of a file, nor in hidden
    folders such as ``.git``, which are never read.
    """
    top = str(path)
    if not os.path.isdir(top):
        return
    places, only = _places(top), _DATA if os.path.isdir(os.path.join(top, "data")) else None
    for folder, folders, files in os.walk(top, onerror=_refuse_unlisted):
        if folder == top:
            folders[:] = [name for name in folders if name[0] != "." and (only is None or name in only)]
        for path in (os.path.join(folder, name) for name in (*folders, *files)):
            if os.path.basename(path).startswith(".") and is_dangling(path):
                continue  # a lock of an editor, which nothing can read
            if os.path.islink(path) or not os.path.isdir(path):
                check_inside(path, top, places)
            if os.path.islink(path) and os.path.isdir(path):
                raise DataError(f"{path}: a link leads to a folder; copy the folder in its place, or remove it.")


def check_inside(path: StrPath, top: StrPath, places: Sequence[str] = ()) -> None:
    """A `DataError` where links on the way from the folder `top` to `path` lead out of it, or to a pipe or nothing.

    What is not there at all is left to the reader. `places` are those of `_places`, where they are known.
    """
    if not os.path.lexists(path):
        return
    real = os.path.realpath(path)
    if not any(real == place or real.startswith(place.rstrip(os.sep) + os.sep) for place in places or _places(top)):
        raise DataError(
            f"{path}: it is a link that leads out of {top}, and is not followed; remove it, or copy the folder with "
            "what its links lead to (cp -rL)."
        )
    if is_dangling(path):
        raise DataError(
            f"{path}: it is a link that leads to nothing, as when a download breaks off; download or copy it again."
        )
    if not (os.path.isfile(real) or os.path.isdir(real)):
        raise DataError(f"{path}: it is a pipe or a device; remove it, or copy the file again.")


def is_dangling(path: StrPath) -> bool:
    """Whether a link leads to nothing."""
    return os.path.islink(path) and not os.path.exists(path)


def _places(top: StrPath) -> list[str]:
    """The folders to which links in the folder `top` may lead: itself, without links, and the ``blobs`` of the Hub.

    In the Hub's cache the files of ``datasets--me--drive/snapshots/1f2e`` are links to ``datasets--me--drive/blobs``.
    """
    real = Path(os.path.realpath(top))
    snapshots = (parent for parent in real.parents if parent.name == "snapshots")
    caches = (parent.parent for parent in snapshots if parent.parent.name.startswith(("datasets--", "models--")))
    return [str(real), *(str(cache / "blobs") for cache in caches)]


def copy_folder(path: Path, new: Path, without: Collection[str] = ()) -> None:
    """Copy what is in a folder that `check_folder` has passed, but the entries `without`; of links what they lead to.

    The first error of the system is raised, and permissions are those of new files.
    """
    new.mkdir()
    for entry in (entry for entry in path.iterdir() if entry.name not in without):
        if entry.is_dir():
            copy_folder(entry, new / entry.name)
        elif not is_dangling(entry):
            shutil.copyfile(entry, new / entry.name)


def _refuse_unlisted(error: OSError) -> None:
    """A `DataError`, but where nothing in a folder can be opened, as in ``lost+found``."""
    if os.access(error.filename, os.X_OK):  # files whose names are known can be opened
        raise DataError(f"{error.filename}: it may not be listed; change its permissions.") from error
