"""Paths of files: checks before reading and writing, and output that is whole or not there."""

from __future__ import annotations

import os
import platform
import re
import shutil
import stat
import time
import uuid
import zlib
from collections.abc import Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from fnmatch import fnmatch
from pathlib import Path

from rpil.data.errors import DataError
from rpil.data.held import held_bytes

_SYNCED_AT_ONCE = 32
"""Files: a disk writes many at once as fast as one."""

_REPEATED_NAME, _MOST_OF_NAME = 200, 255  # bytes that a temporary name repeats, and that file systems take
_TRIES, _PAUSE = 10, 0.1  # in seconds

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
    """`path`, or a `DataError` where it is missing, with names like it, or is a pipe or device."""
    path = Path(path)
    if not path.exists():
        names = map(Path, os.listdir(path.parent) if path.parent.is_dir() else [])
        alike = (name for name in names if bool(name.suffix) == bool(path.suffix))
        there = {name.stem: name for name in alike if path.suffix == name.suffix or path.stem == name.stem}
        close = get_close_matches(path.stem, there, 1, 0.75)
        hint = f"perhaps it is {str(path.parent / there[close[0]])!r}" if close else "check the path"
        raise DataError(f"{path}: there is no such file or folder; {hint}.")
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
        with held_bytes(path) as file:
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
    if len(os.fsencode(path.name)) > _MOST_OF_NAME:
        raise DataError(f"{path}: its name is longer than {_MOST_OF_NAME} bytes; give a shorter one.")
    if path.exists() and not path.is_file():  # to replace /dev/null would break the machine
        raise DataError(f"{path}: it is a folder or a device; give the path of a file.")
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise DataError(f"{path}: it may not be written; choose another place or change the permissions.")
    return path


@contextmanager
def replacing(path: StrPath) -> Iterator[Path]:
    """Yield a path beside `path` to write to, which replaces `path` if the block ends without an error.

    A `DataError` where `path` cannot be written; a file that was there stays as it was, and a file that is replaced
    gives its permissions to the new one. Temporary files of dead processes on this
    computer are deleted.
    """
    # A link stays a link: what it points to is replaced.
    target = Path(os.path.realpath(check_writable(path)))
    with _told_of(path), beside(target) as temporary:
        mode = stat.S_IMODE(target.stat().st_mode) if target.exists() else None
        if mode is not None:  # from the start, so that private data are never readable
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode | stat.S_IRUSR | stat.S_IWUSR))
        yield temporary
        _sync(temporary)
        if mode is not None and mode != stat.S_IMODE(temporary.stat().st_mode):
            temporary.chmod(mode)
        os.replace(temporary, target)
        _sync(target.parent)


@contextmanager
def new_folder(path: StrPath) -> Iterator[Path]:
    """Yield a folder beside `path` to fill, which is called `path` if the block ends without an error.

    A `DataError` where `path` is there already, or cannot be written. Temporary files of dead processes are deleted.
    """
    path = Path(path)
    if path.exists():
        raise DataError(f"{path}: it is there already; give the path of a new folder.")
    with _told_of(path), beside(check_writable(path)) as temporary:
        temporary.mkdir()
        yield temporary
        with ThreadPoolExecutor(_SYNCED_AT_ONCE) as pool:
            list(pool.map(_sync, temporary.rglob("*")))
        _sync(temporary)
        os.rename(temporary, path)
        _sync(path.parent)


@contextmanager
def _told_of(path: StrPath) -> Iterator[None]:
    """A `DataError` that names `path`, the output, instead of an error of the system."""
    try:
        yield
    except OSError as error:
        # Libraries put more into the text of the error than what the system says.
        raise cannot_be_written(path, os.strerror(error.errno) if error.errno else type(error).__name__) from error


def cannot_be_written(path: StrPath, reason: str) -> DataError:
    """The error that names `path`, the output, and what went wrong."""
    return DataError(f"{path}: it cannot be written ({reason}).")


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file or folder beside `path`, which is removed at the end if it is there.

    Temporary files beside `path` of dead processes of this computer are deleted first.
    """
    temporary = temporary_path(path)
    try:
        yield temporary
    finally:
        _remove(temporary)


def temporary_path(path: Path) -> Path:
    """A path beside `path` that names this process; what others that were killed left under such names is removed."""
    # The suffix is kept, because some writers (numpy.savez) add their own to a name without it.
    fits = len(os.fsencode(path.name)) <= _REPEATED_NAME
    stem = path.stem if fits else f"{zlib.crc32(os.fsencode(path.stem)):08x}"
    mark = f".{stem}.{zlib.crc32(_process_space().encode()):08x}-"
    name = re.compile(rf"{re.escape(mark)}(\d+)-[0-9a-f]{{8}}{re.escape(path.suffix)}")
    # Elsewhere os.kill would end the process instead of asking for it.
    for found in filter(None, map(name.fullmatch, os.listdir(path.parent) if os.name == "posix" else ())):
        try:
            os.kill(int(found[1]), 0)
        except ProcessLookupError:
            _remove(path.parent / found[0])
        except (OSError, OverflowError):
            pass  # the process of another user, which lives
    return path.with_name(f"{mark}{os.getpid()}-{uuid.uuid4().hex[:8]}{path.suffix}")


def _process_space() -> str:
    """What tells apart computers and containers of one name, in which a number is not that of the same process."""
    parts = [platform.node()]
    with suppress(OSError):
        parts.append(os.readlink("/proc/self/ns/pid"))
    with suppress(OSError):
        parts.append(Path("/etc/machine-id").read_text())
    return " ".join(parts)


def _remove(path: Path) -> None:
    """Remove a file or a folder, where it is there and may be removed; a link is removed, and not what it leads to."""
    if path.is_symlink() or not path.is_dir():
        with suppress(OSError):
            path.unlink(missing_ok=True)
        return
    for _ in range(_TRIES):
        if not path.exists():
            return
        shutil.rmtree(path, ignore_errors=True)
        time.sleep(_PAUSE)  # threads of a library may go on to write for a while


def _sync(path: Path) -> None:
    """Wait until a file, or the list of what is in a folder, is on the disk, so that a power cut cannot lose it."""
    is_folder, is_posix = path.is_dir(), os.name == "posix"
    if is_folder and not is_posix:  # elsewhere a folder cannot be opened
        return
    opened = os.open(path, os.O_RDONLY if is_posix else os.O_RDWR)
    try:
        os.fsync(opened)
    except OSError:
        if not is_folder:  # which some file systems cannot sync
            raise
    finally:
        os.close(opened)


def check_outputs(inputs: Iterable[StrPath | None], outputs: Iterable[StrPath | None], data: Collection[str]) -> None:
    """A `DataError`, before any work, naming an output that cannot be written, is named twice, or is or joins an input.

    An input may be a folder or a pattern: then a file in the folder with one of the extensions of
    `data`, or one that the pattern matches, joins it.
    """
    sources = [Path(os.path.abspath(path)).resolve() for path in inputs if path]
    taken = set(sources)
    for path in (path for path in outputs if path is not None):
        place = check_writable(path).resolve()
        if place in taken:
            raise DataError(f"{path}: it is named twice in the command; give every file a name of its own.")
        taken.add(place)
        for source in sources:
            in_folder = place.suffix.lower() in data and source.is_dir() and source in place.parents
            if in_folder or fnmatch(str(place), str(source)):
                raise DataError(f"{path}: it would join the data in {source}; write it to another folder.")
