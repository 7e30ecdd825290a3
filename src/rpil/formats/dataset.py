"""`Dataset`: demonstrations whose rows are read block by block, anew for every pass, from files or a table."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpil.data.arrays import ActionKind, Id, Indices, check_any, check_finite
from rpil.data.demonstrations import BLOCK_STEPS, Block, Demonstrations, DemonstrationSet, shard_bounds
from rpil.data.memory import Size, check_memory
from rpil.formats.layout import Layout
from rpil.formats.places import Places
from rpil.formats.rows import Rows, files_of, shifted
from rpil.numerics.types import Array


@dataclass(frozen=True, eq=False)
class Shard:
    """Consecutive blocks of a data set. Iterating reads them from disk, one `Block` after another."""

    rows: Rows
    layout: Layout
    bounds: tuple[int, ...]  # number of the first demonstration of each block, and of the one after the last
    places: Places  # of the demonstrations ``bounds[0]`` .. ``bounds[-1] - 1``

    @property
    def demonstrations(self) -> slice:
        """Numbers of its demonstrations."""
        return slice(self.bounds[0], self.bounds[-1])

    def __iter__(self) -> Iterator[Block]:
        layout, every, row = self.layout, self.places.offsets, int(self.places.offsets[0])
        tables = self.rows.tables(row, int(every[-1]), layout.columns, self.places.demonstration_of)
        begin, table, at = next(tables)
        for first, end in itertools.pairwise(self.bounds):
            offsets = every[first - self.bounds[0] : end - self.bounds[0] + 1]
            start, stop = int(offsets[0]), int(offsets[-1])
            block = Block(first, *layout.empty(stop - start), offsets - start)
            while row < stop:
                if row == begin + len(table):
                    begin, table, at = next(tables)
                until = min(stop, begin + len(table))
                rows, source = slice(row - start, until - start), table.slice(row - begin, until - row)
                layout.fill(block.observations[rows], block.actions[rows], source, shifted(at, row - begin))
                row = until
            yield block


@dataclass(frozen=True, eq=False, repr=False)
class Dataset(DemonstrationSet):
    """Demonstrations on disk, of any size, which `RPIL.fit` takes in the place of `Demonstrations`; see `open`.

    Attributes
    ----------
    ids : tuple
        Ids of the M demonstrations.
    offsets : (M + 1,) int array
        First row of each demonstration, and the number of all rows, N.
    source : str
        Name of the data in messages.
    rows : Rows
        The rows of the files.
    layout : Layout
        The arrays that their columns make.
    classes : (K,) array
        The distinct actions, in order; empty where they are continuous.
    low, high : (A,) arrays
        Smallest and largest continuous actions.
    memory : int or str, optional
        Bytes that those of them that are read into memory may take; by default half of the free memory.
    """

    ids: tuple[Id, ...]
    offsets: NDArray[np.int64]
    source: str
    rows: Rows
    layout: Layout
    classes: Array
    low: Array
    high: Array
    memory: Size | None = None

    @property
    def observation_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the D numbers of an observation."""
        return self.layout.observation_names

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the parts of an action."""
        return self.layout.action_names

    @property
    def n_actions(self) -> int:
        """A, the numbers per action; 0 where actions are discrete."""
        return self.layout.n_parts

    @property
    def nbytes(self) -> int:
        """Bytes that all demonstrations would take in memory."""
        step = self.n_observations * self.layout.observation.itemsize
        return self.n_steps * (step + max(self.n_actions, 1) * self.layout.action.itemsize)

    def shards(self, n_shards: int = 1, block_steps: int = BLOCK_STEPS) -> list[Shard]:
        """All demonstrations in order: shards, each to be iterated over for its blocks, see `shard_bounds`.

        A shard can be sent to another process. Its blocks are those of `Demonstrations.shards`.
        """
        return [self._shard(bounds) for bounds in shard_bounds(self.offsets, n_shards, block_steps)]

    def _shard(self, bounds: Sequence[int]) -> Shard:
        places = Places(self.ids[bounds[0] : bounds[-1]], self.offsets[bounds[0] : bounds[-1] + 1])
        return Shard(self.rows, self.layout, tuple(bounds), places)

    def refuse_faulty(self, numbers: Iterable[int]) -> None:
        """A `DataError` where a value of the demonstrations of these numbers is missing or infinite."""
        for m in sorted(numbers):
            (block,) = self._shard((m, m + 1))
            source = (files_of(self.rows, self.offsets[m : m + 1]) or [self.source])[0]
            names = [f"observation {name!r}" for name in self.observation_names]
            parts = [f"action {a}" for a in range(self.n_actions)]
            for values, what in ((block.observations, names), (block.actions, parts)):
                if what:
                    check_finite(values, tuple(what), block.offsets, self.ids[m : m + 1], source)

    def select(self, indices: Indices) -> Demonstrations:
        """The demonstrations at `indices` (integers, a slice or a mask over the M), in that order, in memory.

        Row groups that hold none of them are not read.
        """
        chosen = np.atleast_1d(np.arange(len(self))[indices])
        order = np.unique(chosen)
        check_any(len(order), self.source)
        offsets = np.concatenate([[0], np.cumsum(self.lengths[order])])
        check_memory(self.nbytes * offsets[-1] / self.n_steps, self.source, self.memory)
        ids = tuple(self.ids[m] for m in order.tolist())
        # Runs of consecutive demonstrations: their first rows, and those after their last.
        heads = np.flatnonzero(np.diff(order, prepend=-2) != 1)
        ends = self.offsets[order[np.append(heads[1:], len(order)) - 1] + 1]
        rows = self.rows.chosen(np.stack([self.offsets[order[heads]], ends], axis=1))
        (block,) = Shard(rows, self.layout, (0, len(order)), Places(ids, offsets))
        kind: ActionKind = "discrete" if self.is_discrete else "continuous"
        names = self.observation_names, self.source, kind, self.action_names, self.layout.allows_missing
        selected = Demonstrations(block.observations, block.actions, offsets, ids, *names)
        return selected if np.array_equal(order, chosen) else selected.select(np.searchsorted(order, chosen))
