"""`Dataset`: demonstrations in Parquet files that are never all in memory.

To open one is to read which demonstration each row is from, and what was done; the observations are read when they are
needed, a block at a time, as often as that may be.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.data.arrays import are_whole, as_actions, as_ids, check_any, check_finite
from rpil.data.demonstrations import Block, Demonstrations, block_bounds
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.formats import table as flat
from rpil.data.formats.store import Store, describe, find_files, shifted


@dataclass(frozen=True, eq=False)
class Shard:
    """A stretch of a data set; to iterate over it is to read it, `Block` by `Block`.

    Attributes
    ----------
    store : Store
    cuts : tuple of int
        Demonstrations that the blocks begin with, and where the last ends.
    offsets : int array
        Rows at which demonstrations ``cuts[0]`` .. ``cuts[-1]`` begin.
    ids : tuple
        Theirs.
    """

    store: Store
    cuts: tuple[int, ...]
    offsets: NDArray[np.int64]
    ids: tuple[Any, ...]

    @property
    def demonstrations(self) -> slice:
        """Which demonstrations it holds."""
        return slice(self.cuts[0], self.cuts[-1])

    def __iter__(self) -> Iterator[Block]:
        store, row = self.store, int(self.offsets[0])
        tables = store.tables(row, int(self.offsets[-1]), store.data_columns, self._whose)
        begin, table, where = next(tables)
        for first, end in itertools.pairwise(self.cuts):
            offsets = self.offsets[first - self.cuts[0] : end - self.cuts[0] + 1]
            block = Block(first, *store.empty(int(offsets[-1] - offsets[0])), offsets - offsets[0])
            while row < offsets[-1]:
                if row == begin + len(table):
                    begin, table, where = next(tables)
                stop = min(int(offsets[-1]), begin + len(table))
                rows, some = slice(row - int(offsets[0]), stop - int(offsets[0])), table.slice(row - begin, stop - row)
                store.fill(block.observations[rows], block.actions[rows], some, shifted(where, row - begin))
                row = stop
            self._check(block, int(offsets[0]))
            yield block

    def _whose(self, row: int) -> str:
        return f", demonstration {self.ids[int(np.searchsorted(self.offsets, row, side='right')) - 1]!r}"

    def _check(self, block: Block, row: int) -> None:
        columns = [(block.observations, [f"observation {name!r}" for name in self.store.names])]
        if self.store.n_parts:
            columns.append((block.actions, [f"action {a}" for a in range(self.store.n_parts)]))
        for values, names in columns:
            finite = np.isfinite(values)
            if not finite.all():
                source = self.store.file_of(row + int(np.argwhere(~finite)[0, 0]))
                check_finite(values, tuple(names), block.offsets, self.ids[block.first - self.cuts[0] :], source)


@dataclass(frozen=True, eq=False, repr=False)
class Dataset:
    """Demonstrations on disk: what `RPIL.fit` takes for `Demonstrations`, of any size. Made by `open_dataset`.

    Attributes
    ----------
    ids : tuple
        Of the demonstrations (M of them).
    offsets : (M + 1,) int array
        Rows at which they begin, and the number of all rows, N.
    source : str
        Its name in messages.
    store : Store
    classes : (K,) array
        The distinct actions, in order; empty where they are continuous.
    low, high : (A,) arrays
        What continuous actions span.
    """

    ids: tuple[Any, ...]
    offsets: NDArray[np.int64]
    source: str
    store: Store
    classes: NDArray[Any]
    low: NDArray[Any]
    high: NDArray[Any]

    @property
    def n_demonstrations(self) -> int:
        """M."""
        return len(self.ids)

    @property
    def n_steps(self) -> int:
        """N."""
        return int(self.offsets[-1])

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Steps per demonstration, (M,)."""
        return np.diff(self.offsets)

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Of the D numbers of an observation."""
        return self.store.names

    @property
    def n_observations(self) -> int:
        """D."""
        return len(self.store.names)

    @property
    def is_discrete(self) -> bool:
        """Whether actions are integers or strings, rather than A floats."""
        return not self.store.n_parts

    @property
    def nbytes(self) -> int:
        """What all demonstrations would take in memory."""
        step = self.n_observations * np.dtype(self.store.observation).itemsize
        return self.n_steps * (step + max(self.store.n_parts, 1) * np.dtype(self.store.action).itemsize)

    def shards(self, n_shards: int = 1) -> list[Shard]:
        """All demonstrations in order: shards of about as many steps, each to be iterated over for its blocks.

        A shard can be sent to where it is read, and is read anew each time. Its blocks are those of `Demonstrations`,
        however many shards there are.
        """
        cuts = block_bounds(self.offsets)
        bounds = np.linspace(0, len(cuts) - 1, min(n_shards, len(cuts) - 1) + 1).astype(int).tolist()
        return [self._shard(cuts[a : b + 1].tolist()) for a, b in itertools.pairwise(bounds)]

    def _shard(self, cuts: Sequence[int]) -> Shard:
        offsets = self.offsets[cuts[0] : cuts[-1] + 1]
        return Shard(
            self.store.between(int(offsets[0]), int(offsets[-1])), tuple(cuts), offsets, self.ids[cuts[0] : cuts[-1]]
        )

    def select(self, indices: Any) -> Demonstrations:
        """The demonstrations at `indices` (integers, a slice or a mask over the M), in that order, in memory.

        Row groups that hold none of them are not read.
        """
        chosen = np.atleast_1d(np.arange(len(self))[indices])
        order = np.unique(chosen)
        offsets = np.concatenate([[0], np.cumsum(self.lengths[order])])
        observations, actions = self.store.empty(int(offsets[-1]))
        # Demonstrations that follow one another are a run.
        heads = np.flatnonzero(np.diff(order, prepend=-2) != 1)
        begins = self.offsets[order[heads]]
        ends = self.offsets[order[np.append(heads[1:], len(order)) - 1] + 1]
        whose = self._shard([0, len(self)])._whose
        for group in self.store.groups:
            inside = np.flatnonzero((begins < group.last) & (ends > group.first)).tolist()
            if not inside:
                continue
            first, last = max(int(begins[inside[0]]), group.first), min(int(ends[inside[-1]]), group.last)
            for row, table, where in self.store.tables(first, last, self.store.data_columns, whose):
                for r in inside:
                    a, b = max(int(begins[r]) - row, 0), min(int(ends[r]) - row, len(table))
                    if a < b:
                        at = int(offsets[heads[r]] - begins[r]) + row
                        rows = slice(at + a, at + b)
                        self.store.fill(observations[rows], actions[rows], table.slice(a, b - a), shifted(where, a))
        ids = tuple(self.ids[m] for m in order.tolist())
        found = Demonstrations(observations, actions, offsets, ids, self.observation_names, self.source)
        return found if np.array_equal(order, chosen) else found.select(np.searchsorted(order, chosen))

    def __len__(self) -> int:
        return self.n_demonstrations

    def __repr__(self) -> str:
        kind = "discrete" if self.is_discrete else "continuous"
        return (
            f"<Dataset from {self.source}: {self.n_demonstrations} demonstrations, {self.n_steps} steps, "
            f"{self.n_observations} observations, {kind} actions>"
        )


def open_dataset(path: StrPath) -> Dataset:
    """Demonstrations in Parquet files, which need not fit in memory.

    Parameters
    ----------
    path : path
        A .parquet file; a folder of such, with all folders in it (of LeRobot's, those in ``data``), taken in the order
        of their names; a pattern such as ``drive/*.parquet``; or an address that pyarrow knows, as ``s3://bucket/folder``.

    Raises
    ------
    DataError
        One sentence: no files, files that differ in their columns, missing values among the actions and ids; rows of
        one demonstration that do not lie together.
    """
    filesystem, paths = find_files(path)
    source = Path(str(path)).name or str(path)
    store = describe(filesystem, paths)
    check_any(store.groups[-1].last if store.groups else 0, source)
    runs, seen = _Runs(), _Seen()
    columns = [store.columns.episode, *store.columns.actions]
    for row, table, where in store.tables(0, store.groups[-1].last, columns):
        if store.action.kind == "U":
            table.validate(full=True)
        runs.add(row, flat.values(table, store.columns.episode, where), where)
        if store.n_parts:
            actions = np.empty((len(table), store.n_parts), store.action)
            store.fill_actions(actions, table, where)
            seen.add_numbers(actions, where)
        else:
            seen.add(flat.values(table, store.columns.actions[0], where).reshape(-1), where)
    ids, offsets = runs.closed(store, source)
    if not store.n_parts and not seen.whole:
        store = replace(store, action=np.dtype(np.float32 if store.action == np.float32 else np.float64), n_parts=1)
    classes = np.empty(0) if store.n_parts else seen.classes
    if not store.n_parts:
        store = replace(store, action=classes.dtype)
    return Dataset(ids, offsets, source, store, classes, np.atleast_1d(seen.low), np.atleast_1d(seen.high))


class _Runs:
    """Where demonstrations begin, as rows go by."""

    def __init__(self) -> None:
        self._starts: list[NDArray[Any]] = []
        self._values: list[NDArray[Any]] = []
        self._last: Any = None
        self._end = 0

    def add(self, row: int, values: NDArray[Any], where: Any) -> None:
        """The demonstrations of some more rows."""
        if values.dtype.kind == "f":
            if not are_whole(values):
                raise DataError(
                    f"{where(0)}: demonstration ids must be whole numbers or text; fill in the missing ones."
                )
            values = values.astype(np.int64)
        if self._values and (self._last.dtype.kind == "U") != (values.dtype.kind == "U"):
            raise DataError(f"{where(0)}: demonstration ids must be all whole numbers or all text.")
        new = np.flatnonzero(np.append(self._last is None or self._last != values[0], values[1:] != values[:-1]))
        self._starts.append(row + new)
        self._values.append(values[new])
        self._last, self._end = values[-1], row + len(values)

    def closed(self, store: Store, source: str) -> tuple[tuple[Any, ...], NDArray[np.int64]]:
        """Their ids, and offsets, once all rows are known."""
        starts, values = np.concatenate(self._starts), np.concatenate(self._values)
        order = np.argsort(values, kind="stable")
        again = np.flatnonzero(values[order[1:]] == values[order[:-1]])
        if len(again):
            one, other = (int(starts[order[k]]) for k in (again[0], again[0] + 1))
            name, files = values[order[again[0]]].item(), [store.file_of(row) for row in (one, other)]
            remedy = (
                f"its rows lie apart in {files[0]}; sort them by {store.columns.episode}, or read the file into memory"
                if files[0] == files[1]
                else f"it is both in {files[0]} and in {files[1]}; give each demonstration its own id, in one file"
            )
            raise DataError(f"{source}, demonstration {name!r}: {remedy}.")
        return as_ids(values.tolist(), source), np.append(starts, self._end).astype(np.int64)


class _Seen:
    """Which actions there are, as rows go by: the distinct ones, and what they span."""

    def __init__(self) -> None:
        self.classes: NDArray[Any] = np.empty(0)
        self.low: Any = np.inf
        self.high: Any = -np.inf
        self.whole = True

    def add(self, values: NDArray[Any], where: Any) -> None:
        """More actions of one number, or text, each."""
        if values.dtype.kind == "f":
            self.add_numbers(values, where)
            self.whole = self.whole and are_whole(values)
        if self.whole:
            fresh = np.unique(as_actions(values, where(0)))
            self.classes = np.union1d(self.classes, fresh) if len(self.classes) else fresh

    def add_numbers(self, values: NDArray[Any], where: Any) -> None:
        """More continuous actions."""
        finite = np.isfinite(values)
        if not finite.all():
            row = int(np.argwhere(~finite)[0, 0])
            raise DataError(f"{where(row)}: an action is not finite; repair it or leave the demonstration out.")
        self.low, self.high = np.minimum(self.low, values.min(axis=0)), np.maximum(self.high, values.max(axis=0))
