"""Whether a file of HDF5 holds all values of an array: the library reads missing ones as the fill value."""

from __future__ import annotations

import math
import os
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from rpil.data.errors import DataError
from rpil.data.missing import are_chunks_filled

if TYPE_CHECKING:
    import h5py


def checked(array: h5py.Dataset) -> h5py.Dataset:
    """The same array, which is read only if all its values are in the file, unless missing ones are filled in."""
    return _checked_class()(array.id)


@cache
def _checked_class() -> Any:
    import h5py

    class CheckedDataset(h5py.Dataset):  # type: ignore[misc]
        _is_whole = False

        @cached_property
        def shape(self) -> tuple[int, ...]:
            """As the file says, which is asked once."""
            return super().shape  # type: ignore[no-any-return]

        def check(self) -> None:
            """A `DataError` where some of its values are not in the file, unless such are filled in here."""
            if not self._is_whole and not are_chunks_filled():
                _check_whole(self)
                self._is_whole = True

        def __getitem__(self, rows: object, new_dtype: np.dtype[np.generic] | None = None) -> object:
            self.check()
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
            f"but {there} in the file; copy or write it again, or, where the writer left out what has one value, have "
            "that value read with <option>.",
            "fill_missing",
        )
