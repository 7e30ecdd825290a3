"""The files of a Zarr store, which is a folder or a ZIP file: they are found by name, and read up to a limit."""

from __future__ import annotations

import os
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from rpil.data.errors import DataError
from rpil.data.guard import guarded
from rpil.data.held import held

ZIP = ".zip"
"""The extension of stores in a ZIP file; a file of another name is never taken for one."""

_PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # which zipfile decodes in small parts


class Files(ABC):
    """The files of a store, which is called `source` in messages."""

    def __init__(self, source: str) -> None:
        self.source = source

    @abstractmethod
    def names(self, folder: str) -> list[str]:
        """The names of all files in a folder and in the folders in it, without the name of the folder."""

    @abstractmethod
    def open(self, name: str) -> IO[bytes]:
        """A file; a `KeyError` or `OSError` where there is none."""

    @abstractmethod
    def _folders(self, folder: str) -> list[str]:
        """The names of the folders in a folder, as they are written."""

    def folders(self, folder: str) -> list[str]:
        """The names of the folders in a folder, in order."""
        return sorted(name for name in self._folders(folder) if name not in ("", ".", "..") and "\\" not in name)

    @abstractmethod
    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""

    def read(self, name: str, limit: int) -> bytes:
        """The bytes of a file; a `DataError` where it has more than `limit`."""
        with self.open(name) as file:
            content = file.read(limit + 1)
        if len(content) > limit:
            raise DataError(f"{self.source}: {name} holds more than {limit:,} bytes; copy or write it again.")
        return content


class _Folder(Files):
    def __init__(self, path: Path) -> None:
        super().__init__(path.name)
        self.path = path

    def names(self, folder: str) -> list[str]:
        found, waiting = [], [""]
        while waiting:
            inner = waiting.pop()
            for entry in self._entries(Path(folder, inner)):
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(f"{inner}{entry.name}/")
                elif entry.is_file():
                    found.append(inner + entry.name)
        return found

    def _folders(self, folder: str) -> list[str]:
        return [entry.name for entry in self._entries(Path(folder)) if entry.is_dir()]

    def _entries(self, folder: Path) -> list[os.DirEntry[str]]:
        root = self.path / folder
        if not root.is_dir():
            return []
        with os.scandir(root) as entries:
            return list(entries)

    def has(self, name: str) -> bool:
        return (self.path / name).is_file()

    def open(self, name: str) -> IO[bytes]:
        if not self.has(name):  # a pipe would be waited for
            raise KeyError(name)
        return (self.path / name).open("rb")


class _Archive(Files):
    def __init__(self, archive: zipfile.ZipFile, source: str) -> None:
        super().__init__(source)
        self.archive = archive
        self.members = {member.filename: member for member in archive.infolist() if not member.is_dir()}

    def names(self, folder: str) -> list[str]:
        return [name.removeprefix(f"{folder}/") for name in self.members if name.startswith(f"{folder}/")]

    def _folders(self, folder: str) -> list[str]:
        return list({name.split("/")[0] for name in self.names(folder) if "/" in name})

    def has(self, name: str) -> bool:
        return name in self.members

    def open(self, name: str) -> IO[bytes]:
        if self.members[name].compress_type not in _PLAIN:
            raise DataError(f"{name} is compressed in a way that is not read; pack the ZIP file again.")
        return self.archive.open(self.members[name])


def is_zip(path: Path) -> bool:
    """Whether `path` is a file that is called a ZIP file."""
    return path.suffix.lower() == ZIP and path.is_file()


@contextmanager
def opened(path: Path) -> Iterator[Files]:
    """The files of a folder or ZIP file; a `DataError` where it is damaged."""
    if not is_zip(path):
        yield _Folder(path)
        return
    with (
        guarded(path.name, "no ZIP file, or a damaged one", "copy or write it again"),
        held(path, lambda: zipfile.ZipFile(path), "ZIP") as archive,
    ):
        yield _Archive(archive, path.name)
