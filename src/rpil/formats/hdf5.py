"""HDF5: opening, listing and copying, for the layouts of the files beside.

No link is followed, because links lead to other files, or in circles. An array is read only if all its values are in
the file: the library itself reads missing ones as the fill value.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpil.data.errors import DataError, optional
from rpil.data.files import cannot_be_written, check_readable, replacing
from rpil.data.guard import guarded
from rpil.data.held import held, held_bytes
from rpil.data.memory import check_free
from rpil.data.names import natural_key
from rpil.formats.description import commas

if TYPE_CHECKING:
    import h5py

SUFFIXES = (".hdf5", ".h5")

_WRITE_FAILED = re.compile(r"write failed.*errno = (\d+)", re.DOTALL)  # in the messages of HDF5
_SIGNATURE = b"\x89HDF\r\n\x1a\n"


def is_hdf5(path: Path) -> bool:
    """Whether the file at `path` says by its name or its first bytes that it is HDF5."""
    if not path.is_file() or path.suffix.lower() in SUFFIXES:
        return path.is_file()
    with held_bytes(path) as file:
        return file.read(len(_SIGNATURE)) == _SIGNATURE


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """The file, to be read; a `DataError` where it is none, or is damaged, a `MissingExtraError` without h5py."""
    h5py = optional("h5py", f"{path.name} is HDF5, which", "hdf5")
    fault = "no HDF5 file, or a damaged one", "copy or write it again"
    with guarded(path.name, *fault), held(path, lambda: h5py.File(check_readable(path), "r")) as file:
        yield file


@contextmanager
def copying(path: Path, output: Path) -> Iterator[tuple[h5py.File, h5py.File]]:
    """The file at `path`, to be read, and a new one, which is at `output` once it is whole.

    A `DataError` that names the `output` where the system fails to write it.
    """
    import h5py

    with opened(path) as source, replacing(output) as temporary:
        try:
            with h5py.File(temporary, "w") as new:
                copy_attributes(source, new)
                yield source, new
        except (OSError, RuntimeError) as error:  # of h5py, for the same cause
            failed = _WRITE_FAILED.search(str(error))
            if failed is None:
                raise
            raise cannot_be_written(output, os.strerror(int(failed[1]))) from error


def copy_attributes(source: h5py.Group, new: h5py.Group) -> None:
    """Copy the attributes of a group."""
    for name, value in source.attrs.items():
        new.attrs[name] = value


def member(group: h5py.Group, name: str) -> h5py.Group | h5py.Dataset | None:
    """What is called `name` in a group; None where nothing is, or a link."""
    import h5py

    links, link = group.id.links, name.encode("utf-8", "surrogateescape")
    is_hard = links.exists(link) and links.get_info(link).type == h5py.h5l.TYPE_HARD
    return _opened_at(group, name) if is_hard else None


def _opened_at(group: h5py.Group, path: str, checked: bool = False) -> h5py.Group | h5py.Dataset | h5py.Datatype:
    """The member at a path without links, `checked` where arrays must be whole; h5py's own look-up takes long."""
    import h5py

    one = h5py.h5o.open(group.id, path.encode("utf-8", "surrogateescape"))
    kinds = {h5py.h5g.GroupID: h5py.Group, h5py.h5d.DatasetID: _checked_class() if checked else h5py.Dataset}
    return kinds.get(type(one), h5py.Datatype)(one)


def members(group: h5py.Group) -> dict[str, h5py.Group | h5py.Dataset]:
    """What is in a group, by name, with the numbers in names in order; what a link leads to is left out."""
    found = {name: member(group, name) for name in sorted(group, key=natural_key)}
    return {name: one for name, one in found.items() if one is not None}


def groups(group: h5py.Group) -> dict[str, h5py.Group]:
    """The groups in a group, by name."""
    import h5py

    return {name: one for name, one in members(group).items() if isinstance(one, h5py.Group)}


class Arrays(Mapping[str, Any]):
    """The arrays in a group by path, each of which is looked up when it is asked for: there may be many groups.

    No link is followed, and each group is visited once, in whatever circles they lie.
    """

    def __init__(self, group: h5py.Group) -> None:
        self.group = group
        self._found: dict[str, object] = {}

    @cached_property
    def _links(self) -> dict[str, int]:
        """The kind of each link in the group, and in the groups to which hard links lead, by path."""
        kinds: dict[str, int] = {}

        def add(path: bytes, link: h5py.h5l.LinkInfo) -> None:
            kinds[path.decode("utf-8", "surrogateescape")] = link.type

        self.group.id.links.visit(add, info=True)
        return {path: kinds[path] for path in sorted(kinds, key=natural_key)}

    def _opened(self, path: str) -> object:
        """What a hard link leads to; None where the link is of another kind, or there is none."""
        import h5py

        return _opened_at(self.group, path, True) if self._links.get(path) == h5py.h5l.TYPE_HARD else None

    def replace(self, path: str, view: Callable[[h5py.Dataset], object]) -> None:
        """Give a `view` of an array from now on, where there is one."""
        if path in self:
            self._found[path] = view(self[path])

    def __getitem__(self, path: str) -> h5py.Dataset:
        import h5py

        if path not in self._found:
            one = self._opened(path)
            array = one if isinstance(one, h5py.Dataset) else None
            is_elsewhere = array and array.id.get_offset() is None and (array.is_virtual or array.external)
            self._found[path] = None if is_elsewhere else array
        if self._found[path] is None:
            raise KeyError(path)
        return self._found[path]

    def __iter__(self) -> Iterator[str]:
        return (path for path in self._links if path in self)

    def __len__(self) -> int:
        return sum(path in self for path in self._links)

    def paths(self) -> set[str]:
        """The paths of all that is no group with something in it; nothing is opened."""
        return {*self._links} - {path.rpartition("/")[0] for path in self._links}

    @property
    def notes(self) -> tuple[str, ...]:
        """That what lies in other files, or behind a link, is not read, in words."""
        import h5py

        others = (path for path in self._links if path not in self)
        links = [path for path in others if not isinstance(self._opened(path), h5py.Group | h5py.Datatype)]
        return (f"Not read, because they are links: {commas(links)}.",) if links else ()


@cache
def _checked_class() -> Any:
    """The class of arrays that are read only if all their values are in the file."""
    import h5py

    class CheckedDataset(h5py.Dataset):  # type: ignore[misc]
        _is_checked = False

        @cached_property
        def shape(self) -> tuple[int, ...]:
            """As the file says, which is asked once."""
            return tuple(self.id.shape or ())  # of an array that holds nothing there is none

        @cached_property
        def dtype(self) -> np.dtype[Any]:
            """As the file says, which is asked once."""
            return self.id.dtype  # type: ignore[no-any-return]

        def __getitem__(self, rows: object, new_dtype: np.dtype[np.generic] | None = None) -> object:
            if not self._is_checked and self.id.get_offset() is None:  # else all values lie together
                _check_whole(self)
                _check_chunks(self)
                self._is_checked = True
            if isinstance(rows, slice):
                n_rows = len(range(*rows.indices(*self.shape[:1])))
                check_free(n_rows * math.prod(self.shape[1:]) * self.dtype.itemsize)
            if isinstance(rows, slice) and rows == slice(0, *self.shape[:1]) and self.dtype.kind in "iuf":
                values = np.empty(self.shape, self.dtype)
                self.id.read(h5py.h5s.ALL, h5py.h5s.ALL, values)  # faster than a selection of rows
                return values
            return super().__getitem__(rows, new_dtype)

    return CheckedDataset


def _check_whole(array: h5py.Dataset) -> None:
    chunks = array.chunks or array.shape
    n_chunks = math.prod(-(-size // step) for size, step in zip(array.shape, chunks, strict=True)) if array.size else 0
    if array.chunks is None:
        n_there = int(array.id.get_storage_size() > 0)
    else:
        n_there = array.id.get_num_chunks() if n_chunks else 0
    if n_there < n_chunks:
        there = f"{n_there:,} of its {n_chunks:,} chunks are" if array.chunks else "none of its values is"
        raise DataError(
            f"{os.path.basename(array.file.filename)}: {str(array.name).strip('/')} declares the shape {array.shape}, "
            f"but {there} in the file; copy or write it again."
        )


def _check_chunks(array: h5py.Dataset) -> None:
    """Raise an error where a chunk does not fit in memory, or its bytes in the file are more than its values take."""
    if not array.chunks:
        return
    chunk_bytes = math.prod(array.chunks) * array.dtype.itemsize
    check_free(chunk_bytes)
    if array.id.get_storage_size() > array.id.get_num_chunks() * (2 * chunk_bytes + 4096):
        raise DataError(
            f"{os.path.basename(array.file.filename)}: the chunks of {str(array.name).strip('/')} hold more than they "
            "declare; copy or write it again."
        )
