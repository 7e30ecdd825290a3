"""Arrays of all steps in a temporary file, written block by block, and read block by block or whole."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from typing import Any

import numpy as np

from rpil.data.errors import DataError
from rpil.numerics.types import Array

_ALIGNMENT = 64
"""An array begins at a multiple of so many bytes, as in memory."""


class StepFile:
    """Arrays with a row for each of `n_steps` steps, in a temporary file, which is gone with the object and its arrays.

    What is read is mapped into memory, and counts as memory of the process for as long as it is needed.
    """

    def __init__(self, n_steps: int) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115  # open as long as the object is there
        weakref.finalize(self, self._file.close)
        self._n_steps = n_steps
        self._arrays: list[tuple[np.dtype[np.generic], int]] = []  # the types of their rows, and where they begin
        self.blocks: list[slice] = []
        """The steps of the blocks that were written."""

    def append(self, block: Any) -> None:
        """Write the next rows of each array in a tuple; a `DataError` at first where there is no room for all steps."""
        if not self.blocks:
            rows = [np.dtype((array.dtype, array.shape[1:])) for array in block]
            sizes = [-(-self._n_steps * row.itemsize // _ALIGNMENT) * _ALIGNMENT for row in rows]
            folder = tempfile.gettempdir()
            if sum(sizes) > (free := shutil.disk_usage(folder).free):
                raise DataError(
                    f"The fit needs {sum(sizes) / 1e9:,.2f} GB for a temporary file, and {folder} has "
                    f"{free / 1e9:,.2f} GB free; set TMPDIR to another folder."
                )
            self._arrays = list(zip(rows, np.cumsum([0, *sizes]).tolist(), strict=False))
        first = self.blocks[-1].stop if self.blocks else 0
        for array, (row, begin) in zip(block, self._arrays, strict=True):
            self._file.seek(begin + first * row.itemsize)
            self._file.write(np.ascontiguousarray(array, row.base).data)
        self._file.flush()
        self.blocks.append(slice(first, first + len(block[0])))

    def read(self, steps: slice) -> list[Array]:
        """The rows of some steps of each array."""
        n_steps = steps.stop - steps.start
        return [
            np.asarray(np.memmap(self._file, row, "r", begin + steps.start * row.itemsize, n_steps))
            for row, begin in self._arrays
        ]
