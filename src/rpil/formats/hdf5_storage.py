"""What HDF5 stores of an array, looked at before its values are read: the library itself believes what a file says."""

from __future__ import annotations

import math
import os
import zlib
from collections.abc import Iterator, Sequence
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from rpil.data.errors import DataError
from rpil.data.memory import check_memory, check_padding
from rpil.data.missing import are_chunks_filled

if TYPE_CHECKING:
    import h5py

_DEFLATE, _SHUFFLE, _FLETCHER32, _LZF = 1, 2, 3, 32_000  # the numbers of filters in HDF5
_LZF_RATIO = 90  # what LZF decodes to, of its size, at most
_FILTER_OVERHEAD = 4096  # bytes that a filter may add to what it cannot compress
_FILTERS = (_DEFLATE, _SHUFFLE, _FLETCHER32, _LZF)
_CHECKSUM_BYTES = 4


def checked(array: h5py.Dataset) -> h5py.Dataset:
    """The same array, which is read only if its storage fits its shape: see `check_storage`."""
    return _checked_class()(array.id)


@cache
def _checked_class() -> Any:
    import h5py

    class CheckedDataset(h5py.Dataset):  # type: ignore[misc]
        _is_checked, _is_whole = False, False

        @cached_property
        def shape(self) -> tuple[int, ...]:
            """As the file says, which is asked once."""
            return super().shape  # type: ignore[no-any-return]

        def check(self) -> None:
            """A `DataError` where some of its values are not in the file, unless such are filled in here."""
            if not self._is_whole and not are_chunks_filled():
                check_whole(self)
                self._is_whole = True

        def __getitem__(self, rows: object, new_dtype: np.dtype[np.generic] | None = None) -> object:
            self.check()
            if not self._is_checked:
                check_storage(self)
                self._is_checked = True
            return super().__getitem__(rows, new_dtype)

    return CheckedDataset


def check_whole(array: h5py.Dataset) -> None:
    """A `DataError` where values that an array declares are not in the file: they would be read as the fill value."""
    chunks = array.chunks or array.shape
    n_chunks = math.prod(-(-size // step) for size, step in zip(array.shape, chunks, strict=True)) if array.size else 0
    if array.chunks is None:
        n_there = int(array.id.get_storage_size() > 0)
    else:
        n_there = array.id.get_num_chunks() if n_chunks else 0
    if n_there < n_chunks:
        there = f"{n_there:,} of its {n_chunks:,} chunks are" if array.chunks else "none of its values is"
        raise DataError(
            f"{_where(array)} declares the shape {array.shape}, but {there} in the file; copy or write it again, or, "
            "where the writer left out what has one value, have that value read with <option>.",
            "fill_missing",
        )


def _where(array: h5py.Dataset) -> str:
    return f"{os.path.basename(array.file.filename)}: {str(array.name).strip('/')}"


def check_storage(array: h5py.Dataset) -> None:
    """A `DataError` where an array that is stored is larger than the file, or a chunk does not decode to its shape."""
    where = _where(array)
    if not array.size or not array.id.get_storage_size():
        return
    if array.chunks is None:
        if array.nbytes > array.file.id.get_filesize():
            raise DataError(
                f"{where} declares the shape {array.shape}, which is more than the file holds; copy it again."
            )
        return
    check_padding(array.shape, array.chunks, array.dtype.itemsize, where)
    filters = _filters(array, where)
    n_bytes = int(np.prod(array.chunks)) * array.dtype.itemsize
    for chunk in _chunks(array):
        if chunk.size > 2 * n_bytes + _FILTER_OVERHEAD or not _fits(array, chunk, filters, n_bytes):
            place = chunk.chunk_offset
            raise DataError(f"{where}: its chunk at {place} does not hold the values of its shape; write it again.")


def _filters(array: h5py.Dataset, where: str) -> list[int]:
    """The filters of an array in the order of writing; a `DataError` where what they decode to is not known."""
    plist = array.id.get_create_plist()
    found = [plist.get_filter(k) for k in range(plist.get_nfilters())]
    numbers = [number for number, *_ in found]
    n_compressing = numbers.count(_DEFLATE) + numbers.count(_LZF)
    if n_compressing > 1 or any(number not in _FILTERS for number in numbers):
        names = ", ".join(name.decode(errors="replace") or str(number) for number, *_, name in found)
        raise DataError(f"{where} is stored with filters that are not read ({names}); write it again with gzip or lzf.")
    return numbers


def _chunks(array: h5py.Dataset) -> Iterator[h5py.h5d.StoreInfo]:
    """Where the chunks of an array are, and how large."""
    found: list[h5py.h5d.StoreInfo] = []
    if hasattr(array.id, "chunk_iter"):
        array.id.chunk_iter(found.append)
        return iter(found)
    return (array.id.get_chunk_info(k) for k in range(array.id.get_num_chunks()))


def _fits(array: h5py.Dataset, chunk: h5py.h5d.StoreInfo, filters: Sequence[int], n_bytes: int) -> bool:
    """Whether a chunk decodes to `n_bytes`."""
    used = [number for k, number in enumerate(filters) if not chunk.filter_mask >> k & 1]
    checksums = _CHECKSUM_BYTES * used.count(_FLETCHER32)
    if _LZF in used:  # the filter leaves alone what it cannot make smaller
        check_memory(_LZF_RATIO * chunk.size, str(array.name))
        return bool(chunk.size <= n_bytes + checksums)
    if _DEFLATE not in used:
        return bool(chunk.size == n_bytes + checksums)
    inner = n_bytes + _CHECKSUM_BYTES * used[: used.index(_DEFLATE)].count(_FLETCHER32)
    content = array.id.read_direct_chunk(chunk.chunk_offset)[1]
    try:
        return len(zlib.decompressobj().decompress(content, inner + 1)) == inner
    except zlib.error:
        return False
