"""Arrays in ZIP files, as ``.npy`` members: their declared sizes are checked first, and nothing is ever unpickled."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from rpil.data.arrays import as_array
from rpil.data.errors import DataError
from rpil.data.guard import guarded
from rpil.data.memory import check_memory
from rpil.numerics.types import Array

ARRAY = ".npy"
"""End of the names of members that hold an array."""

_READ_HEAD = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_arrays(archive: zipfile.ZipFile, members: Sequence[str], where: str) -> list[Array]:
    """The arrays in `members`.

    A `DataError` where they would not fit in memory, or one holds Python objects; where one is damaged, an error of
    another type, such as `ValueError`.
    """
    check_memory(sum(_declared_bytes(archive, member, where) for member in members), where)
    arrays = []
    for member in members:
        with archive.open(member) as stream:
            array = npy.read_array(stream, allow_pickle=False)
            arrays.append(as_array(array, f"the values of {member!r}", where))
    return arrays


@dataclass(frozen=True)
class Npz:
    """The arrays by name in an open NPZ file, which is called `where` in messages."""

    archive: zipfile.ZipFile
    where: str

    @cached_property
    def names(self) -> list[str]:
        """Names of all arrays, in the order of the file."""
        return [name.removesuffix(ARRAY) for name in self.archive.namelist() if name.endswith(ARRAY)]

    def declared(self, name: str) -> tuple[tuple[int, ...], np.dtype[np.generic]]:
        """The shape and the type that an array says it has."""
        return _head(self.archive, name + ARRAY)[:2]

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Some of the arrays; errors are those of `read_arrays`."""
        return dict(zip(names, read_arrays(self.archive, [name + ARRAY for name in names], self.where), strict=True))

    def read_one(self, name: str) -> Array:
        """One of the arrays; errors are those of `read_arrays`."""
        return self.read([name])[name]


def open_npz(path: Path, where: str = "", remedy: str = "write it again") -> Npz:
    """The arrays in the file at `path`, which is closed with them.

    A `DataError` where it is damaged, or two arrays have one name.
    """
    where = where or path.name
    with guarded(where, "not an NPZ file, or a damaged or truncated one", remedy):
        stored = Npz(zipfile.ZipFile(path), where)
    if len(set(stored.names)) < len(stored.names):
        raise DataError(f"{where}: it holds two arrays of one name; {remedy}.")
    return stored


def write_npz(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write an NPZ file. Arrays may have any names; to `numpy.savez_compressed` some are arguments of its own."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        write_arrays(archive, arrays)


def write_arrays(archive: zipfile.ZipFile, arrays: Mapping[str, Array]) -> None:
    """Add arrays as members ``NAME.npy``; a `ValueError` where one holds Python objects."""
    for name, array in arrays.items():
        with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:  # without the time of writing
            npy.write_array(stream, array, allow_pickle=False)


def _declared_bytes(archive: zipfile.ZipFile, member: str, where: str) -> int:
    """Bytes of an array and of its copy as float64; a `ValueError` where the member does not hold as many."""
    shape, dtype, n_before = _head(archive, member)
    if dtype.hasobject:
        raise DataError(
            f"{where}: {member!r} holds Python objects, which are never unpickled because that can run any code; "
            "save plain arrays of numbers or text, with numpy.asarray(values.tolist()) where they are objects."
        )
    n_bytes = math.prod(shape) * dtype.itemsize
    if n_bytes != archive.getinfo(member).file_size - n_before:
        raise ValueError(member)
    return n_bytes + 8 * math.prod(shape)


def _head(archive: zipfile.ZipFile, member: str) -> tuple[tuple[int, ...], np.dtype[np.generic], int]:
    """The shape and the type that an array says it has, and the bytes before its values."""
    with archive.open(member) as stream:
        version = npy.read_magic(stream)
        if version not in _READ_HEAD:
            raise ValueError(f"{member}: version {version[0]}.{version[1]} of the format is not read")
        shape, _, dtype = _READ_HEAD[version](stream)
        return shape, dtype, stream.tell()
