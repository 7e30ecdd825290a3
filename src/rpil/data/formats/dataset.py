"""`Dataset`: demonstrations in Parquet files that are never all in memory.

Opening reads the ids and the actions of all steps; the observations are read block by block, anew for every pass.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpil.data.arrays import Id, Indices, are_whole, as_actions, as_ids, check_any, check_finite
from rpil.data.demonstrations import BLOCK_STEPS, Block, Demonstrations, DemonstrationSet, shard_bounds
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.formats import table as flat
from rpil.data.formats.store import BATCH_ROWS, Store, describe, find_files, shifted
from rpil.data.formats.table import Place
from rpil.data.memory import check_memory
from rpil.numerics.types import Array


@dataclass(frozen=True, eq=False)
class Shard:
    """Consecutive blocks of a data set. Iterating reads them from disk, one `Block` after another."""

    store: Store
    bounds: tuple[int, ...]  # number of the first demonstration of each block, and of the one after the last
    offsets: NDArray[np.int64]  # first rows of the demonstrations ``bounds[0]`` .. ``bounds[-1]``
    ids: tuple[Id, ...]  # of the demonstrations ``bounds[0]`` .. ``bounds[-1] - 1``

    @property
    def demonstrations(self) -> slice:
        """Numbers of its demonstrations."""
        return slice(self.bounds[0], self.bounds[-1])

    def __iter__(self) -> Iterator[Block]:
        store, row = self.store, int(self.offsets[0])
        tables = store.tables(row, int(self.offsets[-1]), store.data_columns, self.demonstration_of)
        begin, table, at = next(tables)
        for first, end in itertools.pairwise(self.bounds):
            offsets = self.offsets[first - self.bounds[0] : end - self.bounds[0] + 1]
            start, stop = int(offsets[0]), int(offsets[-1])
            block = Block(first, *store.empty(stop - start), offsets - start)
            while row < stop:
                if row == begin + len(table):
                    begin, table, at = next(tables)
                until = min(stop, begin + len(table))
                rows, source = slice(row - start, until - start), table.slice(row - begin, until - row)
                store.fill(block.observations[rows], block.actions[rows], source, shifted(at, row - begin))
                row = until
            self._check_values(block, start)
            yield block

    def demonstration_of(self, row: int) -> str:
        """The demonstration of a row of the data set, for messages."""
        return f", demonstration {self.ids[int(np.searchsorted(self.offsets, row, side='right')) - 1]!r}"

    def _check_values(self, block: Block, row: int) -> None:
        observations = block.observations, [f"observation {name!r}" for name in self.store.names]
        actions = block.actions, [f"action {a}" for a in range(self.store.n_parts)]
        for values, names in (observations, actions) if self.store.n_parts else (observations,):
            finite = np.isfinite(values)
            if not finite.all():
                source = self.store.file_of(row + int(np.argwhere(~finite)[0, 0]))
                check_finite(values, tuple(names), block.offsets, self.ids[block.first - self.bounds[0] :], source)


@dataclass(frozen=True, eq=False, repr=False)
class Dataset(DemonstrationSet):
    """Demonstrations on disk, of any size, which `RPIL.fit` takes in the place of `Demonstrations`; see `open_dataset`.

    Attributes
    ----------
    ids : tuple
        Ids of the M demonstrations.
    offsets : (M + 1,) int array
        First row of each demonstration, and the number of all rows, N.
    source : str
        Name of the data in messages.
    store : Store
    classes : (K,) array
        The distinct actions, in order; empty where they are continuous.
    low, high : (A,) arrays
        Smallest and largest continuous actions.
    """

    ids: tuple[Id, ...]
    offsets: NDArray[np.int64]
    source: str
    store: Store
    classes: Array
    low: Array
    high: Array

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the D numbers of an observation."""
        return self.store.names

    @property
    def n_observations(self) -> int:
        """D, the numbers per observation."""
        return len(self.store.names)

    @property
    def is_discrete(self) -> bool:
        """Whether actions are integers or strings, rather than A floats."""
        return not self.store.n_parts

    @property
    def nbytes(self) -> int:
        """Bytes that all demonstrations would take in memory."""
        step = self.n_observations * self.store.observation.itemsize
        return self.n_steps * (step + max(self.store.n_parts, 1) * self.store.action.itemsize)

    def __repr__(self) -> str:
        return self._described(self.n_observations, self.is_discrete, self.source)

    def shards(self, n_shards: int = 1, block_steps: int = BLOCK_STEPS) -> list[Shard]:
        """All demonstrations in order: shards, each to be iterated over for its blocks, see `shard_bounds`.

        A shard can be sent to another process. Its blocks are those of `Demonstrations.shards`.
        """
        return [self._shard(bounds) for bounds in shard_bounds(self.offsets, n_shards, block_steps)]

    def _shard(self, bounds: Sequence[int]) -> Shard:
        offsets = self.offsets[bounds[0] : bounds[-1] + 1]
        store = self.store.between(int(offsets[0]), int(offsets[-1]))
        return Shard(store, tuple(bounds), offsets, self.ids[bounds[0] : bounds[-1]])

    def select(self, indices: Indices) -> Demonstrations:
        """The demonstrations at `indices` (integers, a slice or a mask over the M), in that order, in memory.

        Row groups that hold none of them are not read.
        """
        chosen = np.atleast_1d(np.arange(len(self))[indices])
        order = np.unique(chosen)
        offsets = np.concatenate([[0], np.cumsum(self.lengths[order])])
        check_memory(self.nbytes * offsets[-1] / self.n_steps, self.source)
        observations, actions = self.store.empty(int(offsets[-1]))
        # Runs of consecutive demonstrations: their first and last rows, and the first row of each in the result.
        heads = np.flatnonzero(np.diff(order, prepend=-2) != 1)
        begins = self.offsets[order[heads]]
        ends = self.offsets[order[np.append(heads[1:], len(order)) - 1] + 1]
        demonstration_of = self._shard([0, len(self)]).demonstration_of
        for group in self.store.groups:
            runs = np.flatnonzero((begins < group.last) & (ends > group.first)).tolist()
            if not runs:
                continue
            first, last = max(int(begins[runs[0]]), group.first), min(int(ends[runs[-1]]), group.last)
            for row, table, at in self.store.tables(first, last, self.store.data_columns, demonstration_of):
                for r in runs:
                    a, b = max(int(begins[r]) - row, 0), min(int(ends[r]) - row, len(table))
                    if a < b:
                        start = int(offsets[heads[r]] - begins[r]) + row
                        rows = slice(start + a, start + b)
                        self.store.fill(observations[rows], actions[rows], table.slice(a, b - a), shifted(at, a))
        ids = tuple(self.ids[m] for m in order.tolist())
        selected = Demonstrations(observations, actions, offsets, ids, self.observation_names, self.source)
        return selected if np.array_equal(order, chosen) else selected.select(np.searchsorted(order, chosen))


def open_dataset(path: StrPath, *, batch_rows: int = BATCH_ROWS) -> Dataset:
    """Open demonstrations in Parquet files, which need not fit in memory.

    Parameters
    ----------
    path : path
        A .parquet file; a folder of such files, with all folders in it (of LeRobot's, those in ``data``), taken in the
        order of their names; a pattern such as ``drive/*.parquet``; or an address that pyarrow knows, such as
        ``s3://bucket/folder``.
    batch_rows : int
        Rows that are decoded at a time.

    Raises
    ------
    DataError
        One sentence: no files, files with different columns, missing values among the actions and ids, or a
        demonstration whose rows are not consecutive.
    """
    filesystem, paths = find_files(path)
    source = Path(str(path)).name or str(path)
    store = replace(describe(filesystem, paths), batch_rows=batch_rows)
    n_rows = store.groups[-1].last if store.groups else 0
    check_any(n_rows, source)
    starts, actions = _Starts(), _ActionRange()
    columns = [store.columns.episode, *store.columns.actions]
    for row, table, at in store.tables(0, n_rows, columns):
        if store.action.kind == "U":
            table.validate(full=True)
        starts.add(row, flat.column_values(table, store.columns.episode, at), at)
        if store.n_parts:
            continuous = np.empty((len(table), store.n_parts), store.action)
            store.fill_actions(continuous, table, at)
            actions.add_numbers(continuous, at)
        else:
            actions.add(flat.column_values(table, store.columns.actions[0], at).reshape(-1), at)
    ids, offsets = starts.finish(store, source)
    classes = np.empty(0) if store.n_parts or not actions.whole else actions.classes
    if not store.n_parts and actions.whole:
        store = replace(store, action=classes.dtype)
    elif not store.n_parts:
        store = replace(store, action=np.dtype(np.float32 if store.action == np.float32 else np.float64), n_parts=1)
    return Dataset(ids, offsets, source, store, classes, np.atleast_1d(actions.low), np.atleast_1d(actions.high))


class _Starts:
    """Collects the first row and the id of every demonstration, table by table."""

    def __init__(self) -> None:
        self._starts: list[Array] = []
        self._ids: list[Array] = []
        self._last: Array | None = None
        self._n_rows = 0

    def add(self, row: int, ids: Array, at: Place) -> None:
        """Add the ids of the rows from number `row` on."""
        if ids.ndim != 1:
            raise DataError(f"{at(0)}: demonstration ids must be whole numbers or text, not lists.")
        if ids.dtype.kind == "f":
            if not are_whole(ids):
                raise DataError(f"{at(0)}: demonstration ids must be whole numbers or text; fill in the missing ones.")
            ids = ids.astype(np.int64)
        if self._last is not None and (self._last.dtype.kind == "U") != (ids.dtype.kind == "U"):
            raise DataError(f"{at(0)}: demonstration ids must be all whole numbers or all text.")
        new = np.flatnonzero(np.append(self._last is None or self._last != ids[:1], ids[1:] != ids[:-1]))
        self._starts.append(row + new)
        self._ids.append(ids[new])
        self._last, self._n_rows = ids[-1:], row + len(ids)

    def finish(self, store: Store, source: str) -> tuple[tuple[Id, ...], NDArray[np.int64]]:
        """The ids, and the offsets, once all rows were added."""
        starts, ids = np.concatenate(self._starts), np.concatenate(self._ids)
        order = np.argsort(ids, kind="stable")
        repeated = np.flatnonzero(ids[order[1:]] == ids[order[:-1]])
        if len(repeated):
            k = repeated[0]
            first, second = (store.file_of(int(starts[order[m]])) for m in (k, k + 1))
            remedy = f"it is both in {first} and in {second}; give each demonstration its own id, in one file"
            if first == second:
                remedy = f"its rows lie apart in {first}; sort them by {store.columns.episode}, or read it into memory"
            raise DataError(f"{source}, demonstration {ids[order[k]].item()!r}: {remedy}.")
        return as_ids(ids.tolist(), source), np.append(starts, self._n_rows).astype(np.int64)


class _ActionRange:
    """Collects the distinct actions and the range of continuous ones, table by table."""

    def __init__(self) -> None:
        self.classes: Array = np.empty(0)
        self.low: Array = np.array(np.inf)
        self.high: Array = np.array(-np.inf)
        self.whole = True

    def add(self, values: Array, at: Place) -> None:
        """Add actions (N,), of one number or text each."""
        if values.dtype.kind == "f":
            self.add_numbers(values, at)
            self.whole = self.whole and are_whole(values)
        if self.whole:
            classes = np.unique(as_actions(values, at(0)))
            self.classes = np.union1d(self.classes, classes) if len(self.classes) else classes

    def add_numbers(self, values: Array, at: Place) -> None:
        """Add continuous actions, (N,) or (N, A)."""
        finite = np.isfinite(values)
        if not finite.all():
            row = int(np.argwhere(~finite)[0, 0])
            raise DataError(f"{at(row)}: an action is not finite; repair it or leave the demonstration out.")
        self.low, self.high = np.minimum(self.low, values.min(axis=0)), np.maximum(self.high, values.max(axis=0))
