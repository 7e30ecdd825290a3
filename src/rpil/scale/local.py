"""The engine of this process: each block is summed by one thread, so that the number of threads changes no bit."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from typing import Any, cast

import numpy as np

from rpil.data.errors import DataError
from rpil.numerics.parallel import cores
from rpil.numerics.types import Array
from rpil.scale.protocol import R, Shards, T

_ALIGNMENT = 64
"""An array begins at a multiple of so many bytes, as in memory."""


def identity(block: T) -> T:
    """The block as it is."""
    return block


@dataclass(frozen=True)
class LocalBlocks(Shards[T]):
    """Blocks that are read, and from which `prepare` computes others, in every pass until these are kept."""

    shards: Sequence[Iterable[object]]
    prepare: Callable[[Any], T] = identity

    def map(self, function: Callable[[T], R]) -> Iterator[R]:
        """At most one block more than there are cores is in memory."""
        pending: deque[Future[R]] = deque()
        with ThreadPoolExecutor(cores()) as pool:
            for block in chain.from_iterable(self.shards):
                pending.append(pool.submit(lambda one: function(self.prepare(one)), block))
                del block
                if len(pending) > cores():
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()

    def then(self, function: Callable[[T], R]) -> Shards[R]:
        return LocalBlocks(self.shards, lambda block: function(self.prepare(block)))

    def kept(self, n_steps: int) -> Shards[T]:
        """The blocks, which are named tuples of arrays, in a temporary file."""
        file, kind = StepFile(n_steps), cast(Any, None)
        for block in self.map(identity):
            file.append(block)
            kind = type(block)
        return LocalBlocks([file.blocks], lambda steps: kind(*file.read(steps)))


@dataclass(frozen=True)
class LocalEngine:
    """The engine of this process, which works on as many blocks at a time as there are cores."""

    n_shards: int = 1

    def place(self, shards: Sequence[Iterable[T]]) -> Shards[T]:
        return LocalBlocks(shards)


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
        n, first, arrays = steps.stop - steps.start, steps.start, list[Any]()
        for row, begin in self._arrays:
            arrays.append(np.memmap(self._file, row, "r", begin + first * row.itemsize, n))
            with suppress(AttributeError, OSError):  # other systems, and old kernels, map page by page
                arrays[-1].base.madvise(22 if n < self._n_steps else 0)  # all that a block needs: MADV_POPULATE_READ
        return list(map(np.asarray, arrays))


def gathered(blocks: Iterable[Array], n_steps: int) -> Array:
    """One array of `n_steps` steps, whose parts come in order, in a temporary file."""
    file = StepFile(n_steps)
    for block in blocks:
        file.append((block,))
    return file.read(slice(0, n_steps))[0]
