"""Folders of data: no link that leads out of the named folder is followed, and no pipe or device in it is opened."""

from __future__ import annotations

import os
import shutil
from collections.abc import Collection, Sequence
from pathlib import Path

from rpil.data.errors import DataError
from rpil.data.files import StrPath

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
            folders[:] = [name for name in folders if not is_hidden(name) and (only is None or name in only)]
        for path in (os.path.join(folder, name) for name in (*folders, *files)):
            if is_hidden(os.path.basename(path)) and is_dangling(path):  # a lock of an editor, which nothing can read
                continue
            if os.path.islink(path) or not os.path.isdir(path):
                _check_place(path, top, places)
            if os.path.islink(path) and os.path.isdir(path):
                raise DataError(f"{path}: a link leads to a folder; copy the folder in its place, or remove it.")


def check_inside(path: StrPath, top: StrPath) -> None:
    """A `DataError` where links on the way from the folder `top` to `path` lead out of it, or to a pipe or nothing.

    What is not there at all is left to the reader.
    """
    if os.path.lexists(path):
        _check_place(path, top, _places(top))


def _check_place(path: StrPath, top: StrPath, places: Sequence[str]) -> None:
    """A `DataError` where links lead from `path` to none of the `places`, or to no file or folder."""
    real = os.path.realpath(path)
    if not any(real == place or real.startswith(place.rstrip(os.sep) + os.sep) for place in places):
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


def is_hidden(name: str) -> bool:
    """Whether a file or folder has a name that lists leave out."""
    return name.startswith(".")


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
