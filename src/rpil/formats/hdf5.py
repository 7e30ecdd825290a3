"""HDF5 as a container of named arrays, and copies of a file with some of its groups.

No link is followed, because links lead to other files, or in circles. An array is read only if all its values are in
the file: the library itself reads missing ones as the fill value.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Container, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError, optional
from rpil.data.files import cannot_be_written, check_readable, replacing
from rpil.data.guard import guarded
from rpil.data.held import held
from rpil.data.memory import check_free
from rpil.data.names import natural_key
from rpil.formats.array_layout import Arrays
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import kept_of

if TYPE_CHECKING:
    import h5py

_WRITE_FAILED = re.compile(r"write failed.*errno = (\d+)", re.DOTALL)  # in the messages of HDF5


@contextmanager
def opened_hdf5(path: Path, options: ColumnOptions = ColumnOptions()) -> Iterator[tuple[h5py.File, Arrays]]:
    """The file, and the arrays in it by path, each of which is opened when it is asked for: there may be many.

    Each group is visited once, in whatever circles hard links lie. A `DataError` where this is no file of HDF5, or it
    is damaged, a `MissingExtraError` without h5py.
    """
    h5py, kinds = optional("h5py", f"{path.name} is HDF5, which", "hdf5"), dict[bytes, int]()
    fault = "no HDF5 file, or a damaged one", "copy or write it again"
    with guarded(path.name, *fault), held(path, lambda: h5py.File(check_readable(path), "r")) as file:
        file.id.links.visit(lambda place, link: kinds.update({place: link.type}), info=True)
        is_hard = {m.decode("utf-8", "surrogateescape"): kind == h5py.h5l.TYPE_HARD for m, kind in kinds.items()}
        groups = {place.rpartition("/")[0] for place in is_hard}
        leaves = [place for place in sorted(is_hard, key=natural_key) if place not in groups]
        found = {place: _FileArray(file, place) for place in leaves if is_hard[place]}
        links = [place for place in leaves if place not in found]
        yield file, Arrays(found, path.name, options, lambda group: file[group or "/"].attrs, links)


class _FileArray:
    """An array that is read only if all its values are in the file, and fit in memory; of others nothing is known."""

    def __init__(self, file: h5py.File, path: str) -> None:
        self._file, self._path = file, path

    @cached_property
    def _stored(self) -> h5py.h5d.DatasetID | None:
        import h5py

        one = h5py.h5o.open(self._file.id, self._path.encode("utf-8", "surrogateescape"))  # faster than by its class
        if not isinstance(one, h5py.h5d.DatasetID):
            return None
        is_away = one.get_offset() is None and (h5py.Dataset(one).is_virtual or h5py.Dataset(one).external)
        return None if is_away else one

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """As the file says."""
        return () if self._stored is None else tuple(self._stored.shape or ())

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """As the file says."""
        return np.dtype(object) if self._stored is None else self._stored.dtype

    def __getitem__(self, rows: object) -> object:
        import h5py

        n_rows = len(range(*rows.indices(*self.shape[:1]))) if isinstance(rows, slice) else 0
        check_free(n_rows * math.prod(self.shape[1:]) * self.dtype.itemsize)
        whole = self._whole
        if whole is None or not n_rows or n_rows < self.shape[0] or self.dtype.hasobject:
            return h5py.Dataset(whole)[rows]
        values = np.empty(self.shape, self.dtype)
        whole.read(h5py.h5s.ALL, h5py.h5s.ALL, values)  # half the time, where there are thousands of small arrays
        return values

    @cached_property
    def _whole(self) -> h5py.h5d.DatasetID | None:
        """The array; an error where chunks are missing, or their bytes in the file are more than their values take."""
        import h5py

        if self._stored is None or self._stored.get_offset() is not None:  # all values lie together
            return self._stored
        where, stored = f"{os.path.basename(self._file.filename)}: {self._path}", h5py.Dataset(self._stored)
        grid = [-(-size // step) for size, step in zip(self.shape, stored.chunks or self.shape, strict=True) if step]
        n_chunks, n_bytes = math.prod(grid) if stored.size else 0, stored.id.get_storage_size()
        n_there = stored.id.get_num_chunks() if stored.chunks and n_chunks else int(n_bytes > 0)
        if n_there < n_chunks:
            fault = f"declares the shape {self.shape}, but {n_there:,} of its {n_chunks:,} chunks are in the file"
            raise DataError(f"{where} {fault}; copy or write it again.")
        chunk_bytes = math.prod(stored.chunks or ()) * self.dtype.itemsize
        check_free(chunk_bytes)
        if stored.chunks and n_bytes > n_there * (2 * chunk_bytes + 4096):
            raise DataError(f"{where}: its chunks hold more than they declare; copy or write it again.")
        return self._stored


def keep_groups(path: Path, output: Path, ids: Sequence[Id]) -> None:
    """Write the demonstrations called `ids`, and all else of the file, to a new one; filter keys name no others.

    A `DataError` that names the `output` where the system fails to write it.
    """
    import h5py

    with opened_hdf5(path) as (source, arrays), replacing(output) as temporary:
        within, found = arrays.groups()
        names = kept_of(found, ids, path)
        try:
            with h5py.File(temporary, "w") as new:
                dropped = found.keys() - names
                _copy(source, new, {"mask", within.strip("/")} if within else {"mask", *dropped})
                if within:
                    _copy(source[within], new.create_group(within), dropped)
                if "total" in (about := new[within or "/"].attrs):
                    about["total"] = sum(found[name].n_steps for name in names)
                for key, one in arrays.arrays.items():
                    if key.startswith("mask/") and one.shape:
                        listed = [name for name in np.asarray(one[:]).tolist() if name.decode() in names]
                        new[key] = np.array(listed, dtype="S")
        except (OSError, RuntimeError) as error:  # of h5py, for the same cause
            failed = _WRITE_FAILED.search(str(error))
            if failed is None:
                raise
            raise cannot_be_written(output, os.strerror(int(failed[1]))) from error


def _copy(group: h5py.Group, new: h5py.Group, without: Container[str]) -> None:
    """Copy the attributes of a group and its members, but for links and those that are to be left out."""
    import h5py

    for name, value in group.attrs.items():
        new.attrs[name] = value
    for name in group:
        if name not in without and isinstance(group.get(name, getlink=True), h5py.HardLink):
            group.copy(name, new)
