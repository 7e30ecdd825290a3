"""`Dataset`: demonstrations in Parquet files that are never all in memory.

Opening reads the ids and the actions of all steps; the observations are read block by block, anew for every pass.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rpil.data.arrays import (
    MAX_CLASSES,
    ActionKind,
    Id,
    Indices,
    are_whole,
    as_actions,
    check_any,
    check_finite,
    kind_by_count,
    number_reason,
)
from rpil.data.demonstrations import BLOCK_STEPS, Block, Demonstrations, DemonstrationSet, shard_bounds
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.guard import guard
from rpil.data.memory import check_memory
from rpil.data.missing import are_allowed
from rpil.formats import table as flat
from rpil.formats.columns import ColumnOptions
from rpil.formats.lerobot import Metadata
from rpil.formats.order import Order
from rpil.formats.starts import OrderCheck, Starts
from rpil.formats.store import BATCH_ROWS, Store, describe, find_files, shifted
from rpil.formats.table import Place
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa


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


@dataclass(frozen=True, eq=False)
class About:
    """What the files of a data set say beside the demonstrations."""

    n_files: int
    ignored_files: tuple[str, ...]
    metadata: Metadata
    order: Order
    action_reason: str  # why actions are discrete or continuous
    operators: list[tuple[str, object]]  # the different pairs of id, as text, and operator
    tasks: list[tuple[str, object]]


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
    about : About
        What the files say beside the demonstrations.
    """

    ids: tuple[Id, ...]
    offsets: NDArray[np.int64]
    source: str
    store: Store
    classes: Array
    low: Array
    high: Array
    about: About

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the D numbers of an observation."""
        return self.store.names

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the parts of an action."""
        actions = self.store.columns.actions
        widths = dict.fromkeys(actions, max(self.store.n_parts, 1) // len(actions))
        return flat.part_names(widths, self.about.metadata.names)

    @property
    def n_observations(self) -> int:
        """D, the numbers per observation."""
        return len(self.store.names)

    @property
    def is_discrete(self) -> bool:
        """Whether actions are integers or strings, rather than A floats."""
        return not self.store.n_parts

    @property
    def n_actions(self) -> int:
        """A, the numbers per action; 0 where actions are discrete."""
        return self.store.n_parts

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
        kind: ActionKind = "discrete" if self.is_discrete else "continuous"
        names = self.observation_names, self.source, kind, self.action_names
        selected = Demonstrations(observations, actions, offsets, ids, *names)
        return selected if np.array_equal(order, chosen) else selected.select(np.searchsorted(order, chosen))


@guard
def open_dataset(path: StrPath, *, options: ColumnOptions = ColumnOptions(), batch_rows: int = BATCH_ROWS) -> Dataset:
    """Open demonstrations in Parquet files, which need not fit in memory.

    Parameters
    ----------
    path : path
        A .parquet file; a folder of such files, with all folders in it (of LeRobot's, those in ``data``), taken in the
        order of their names; a pattern such as ``drive/*.parquet``; or an address that pyarrow knows, such as
        ``s3://bucket/folder``.
    options : ColumnOptions
        What each column holds, where its name does not say it.
    batch_rows : int
        Rows that are decoded at a time.

    Raises
    ------
    DataError
        One sentence: no files, files with different columns, missing values among the actions and ids, or a
        demonstration whose rows are not consecutive, or not in the order of their column.
    """
    filesystem, paths, text_files = find_files(path)
    if not paths:
        raise DataError(
            f"{path}: no .parquet file is there; only Parquet files make a data set on disk: read it into memory, or "
            "use rpil convert."
        )
    source = Path(str(path)).name or str(path)
    store, metadata = describe(filesystem, paths, options)
    store = replace(store, batch_rows=batch_rows)
    n_rows = store.groups[-1].last if store.groups else 0
    check_any(n_rows, source)
    given = store.columns
    starts, actions, orders = Starts(given.episode), _ActionRange(options), OrderCheck(given)
    names = [name for name in (given.operator, given.task) if name is not None]
    pairs: dict[str, dict[tuple[str, object], None]] = {name: {} for name in names}
    columns = list(dict.fromkeys([given.episode, *given.actions, *given.orders, *given.parts, *names]))
    for row, table, at in store.tables(0, n_rows, columns):
        table.validate(full=True)
        begins = starts.add(row, table, at)
        orders.add(table, begins, at)
        actions.add(store, table, at)
        for name in names:
            rows = table.group_by([given.episode, name], use_threads=False).aggregate([])
            owners = map(str, rows[given.episode].to_pylist())
            pairs[name] |= dict.fromkeys(zip(owners, rows[name].to_pylist(), strict=True))
    ids, offsets = starts.finish(store, source)
    store, reason = actions.finish(store, source)
    found = [list(pairs.get(name or "", ())) for name in (given.operator, given.task)]
    about = About(len(paths), tuple(text_files), metadata, orders.finish(source), reason, *found)
    low, high = np.atleast_1d(actions.low), np.atleast_1d(actions.high)
    return Dataset(ids, offsets, source, store, actions.classes, low, high, about)


class _ActionRange:
    """Collects the distinct actions and the range of continuous ones, table by table."""

    def __init__(self, options: ColumnOptions) -> None:
        self.wanted = options.action_kind
        self.classes: Array = np.empty(0)
        self.low: Array = np.array(np.inf)
        self.high: Array = np.array(-np.inf)
        self.n_steps = 0
        self.is_text = False
        self.whole = True

    def add(self, store: Store, table: pa.Table, at: Place) -> None:
        """Add the actions of a table."""
        self.n_steps += len(table)
        if store.n_parts:
            numbers = np.empty((len(table), store.n_parts), store.action)
            store.fill_actions(numbers, table, at)
            self._add_numbers(numbers, at)
            return
        values = flat.column_values(table, store.columns.actions[0], at).reshape(-1)
        self.is_text = values.dtype.kind == "U"
        if not self.is_text:
            self._add_numbers(values, at)
            self.whole = self.whole and (values.dtype.kind != "f" or are_whole(values))
        if self.whole and (self.is_text or self.wanted == "discrete" or len(self.classes) <= MAX_CLASSES):
            classes = np.unique(as_actions(values, at(0), "discrete"))
            self.classes = np.union1d(self.classes, classes) if len(self.classes) else classes

    def _add_numbers(self, values: Array, at: Place) -> None:
        """Add numbers, (N,) or (N, A)."""
        finite = np.isfinite(values)
        if not finite.all() and not are_allowed():
            row = int(np.argwhere(~finite)[0, 0])
            raise DataError(f"{at(row)}: an action is not finite; repair it or leave the demonstration out.")
        self.low, self.high = np.minimum(self.low, values.min(axis=0)), np.maximum(self.high, values.max(axis=0))

    def finish(self, store: Store, source: str) -> tuple[Store, str]:
        """The store with the type of its actions, and why it has it."""
        if store.n_parts:
            return store, number_reason(store.n_parts)
        kind, reason = kind_by_count(len(self.classes), self.n_steps, self.is_text, self.whole, self.wanted, source)
        if kind == "discrete":
            return replace(store, action=self.classes.dtype), reason
        self.classes = np.empty(0)
        single = store.action == np.float32
        return replace(store, action=np.dtype(np.float32 if single else np.float64), n_parts=1), reason
