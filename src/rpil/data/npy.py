"""Arrays in ZIP files, as ``.npy`` members: their declared sizes are checked first, and nothing is ever unpickled."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Sequence

from numpy.lib import format as npy

from rpil.data.arrays import as_array
from rpil.data.errors import DataError
from rpil.data.memory import check_memory
from rpil.numerics.types import Array

_READ_HEAD = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_arrays(archive: zipfile.ZipFile, members: Sequence[str], where: str) -> list[Array]:
    """The arrays in `members`.

    A `DataError` where they would not fit in memory, or one holds Python objects; where one is damaged, an error of
    another type, such as `ValueError`.
    """
    check_memory(sum(_declared_bytes(archive, member, where) for member in members), where)
    return [_read_array(archive, member, where) for member in members]


def _declared_bytes(archive: zipfile.ZipFile, member: str, where: str) -> int:
    """Bytes of an array and of its copy as float64; a `ValueError` where the member does not hold as many."""
    with archive.open(member) as stream:
        shape, _, dtype = _READ_HEAD[npy.read_magic(stream)](stream)
        if dtype.hasobject:
            raise DataError(
                f"{where}: {member!r} holds Python objects, which are never unpickled because that can run any code; "
                "save plain arrays of numbers or text, with numpy.asarray(values.tolist()) where they are objects."
            )
        n_bytes = math.prod(shape) * dtype.itemsize
        if n_bytes != archive.getinfo(member).file_size - stream.tell():
            raise ValueError(member)
    return n_bytes + 8 * math.prod(shape)


def _read_array(archive: zipfile.ZipFile, member: str, where: str) -> Array:
    with archive.open(member) as stream:
        return as_array(npy.read_array(stream, allow_pickle=False), f"the values of {member!r}", where)
