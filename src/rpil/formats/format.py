"""The record of a format, with which the module of the format ends; and what one reads: tables of steps, the arrays
that their columns make, and `Dataset`: demonstrations whose rows are read block by block in every pass."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rpil.data.arrays import ActionKind, Id, Indices, check_any
from rpil.data.demonstrations import BLOCK_STEPS, Block, Demonstrations, DemonstrationSet, shard_bounds
from rpil.data.errors import DataError, guarded
from rpil.data.memory import Size, check_memory
from rpil.data.text import short_name
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import FILE, ColumnOptions, Columns, check_names
from rpil.formats.steps import ArrowFile, Steps
from rpil.formats.table import Place
from rpil.numerics.types import Array


@runtime_checkable
class Frame(Protocol):
    """A data frame of pandas, polars, pyarrow or another library that gives its columns to Arrow."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """Its columns."""


@dataclass(frozen=True)
class Metadata:
    """Statements of a recording on itself: attributes of a file, or LeRobot's ``meta``; empty where it says nothing."""

    version: str = ""
    fps: float | None = None
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # of the numbers in a column of lists
    tasks: Mapping[str, str] = field(default_factory=dict)  # by task_index, as text
    videos: tuple[str, ...] = ()  # observations that lie beside the table
    n_cameras: int = 0  # of videos and of images
    lengths: Mapping[Id, int] = field(default_factory=dict)  # declared steps of each demonstration


@dataclass(frozen=True, eq=False)
class StepTables:
    """Result of a reader: tables one below the other, with a row for each step, and what the files say beside them."""

    tables: Iterable[pa.Table] | ArrowFile  # read one by one; or a file of them
    columns: Columns
    source: str  # the name of the data in messages
    format_name: str
    sizes: Mapping[str, int] = field(default_factory=dict)  # rows of each file, where files may state an order
    metadata: Metadata = Metadata()
    notes: tuple[str, ...] = ()  # what a user should know, in sentences
    ignored: Mapping[str, str] = field(default_factory=dict)  # parts of the file that are no columns, and why
    skipped: tuple[str, ...] = ()  # damaged files, which are not read
    place: Array | None = None  # (N,), of each row in the files; None where all are there


def from_arrow(
    tables: Iterable[pa.Table], options: ColumnOptions, source: str, format_name: str, default_id: str | None = None
) -> StepTables:
    """The recording in tables with a row for each step, by the columns that `find_columns` finds in the first."""
    waiting = map(plain_columns, tables)
    table = next(waiting, pa.table({}))
    check_names(table.column_names, source)
    lists = flat.parts_of_lists(table, {})
    head = table.select([name for name in table.column_names if name != FILE]).slice(0, flat.HEAD_ROWS)
    columns = find_columns(flat.kinds_of(head), source, options, default_id, lists)
    chosen = (flat.flattened(one.select(columns.stored), lists, columns.all) for one in chain([table], waiting))
    return StepTables(chosen, columns, source, format_name)


def plain_columns(table: pa.Table) -> pa.Table:
    """A column for each part of a structure, such as ``observation.pos``, and text as files have it."""
    while any(map(pa.types.is_struct, table.schema.types)):
        table = table.flatten()
    for k, one in enumerate(table.schema):
        if pa.types.is_string_view(flat.plain_type(one.type)):
            table = table.set_column(k, one.name, table[k].cast(pa.string()))
    return table


def called(*suffixes: str) -> Callable[[Path], bool]:
    """Whether a path is a file whose name ends so."""
    return lambda path: path.is_file() and path.name.lower().endswith(suffixes)


@dataclass(frozen=True)
class Defect:
    """Something of a folder that does not agree with its data; `place` is a file, or an episode."""

    what: str
    place: str
    sentence: str


@dataclass(frozen=True)
class Shot:
    """Where a camera's frames of an episode are: a file, and seconds in it; `n_rows` are those of the data."""

    camera: str
    episode: int
    path: Path
    start: float
    end: float
    n_rows: int


@dataclass(frozen=True)
class Format:
    """The abilities of a format; what is left out of the record, it cannot."""

    name: str  # in messages
    # Whether the file or folder there has this format: False if unsure, and a `DataError` only to stop the search.
    claims: Callable[[Path], bool]
    read: Callable[[Path, ColumnOptions], StepTables]  # a `DataError` where it cannot be read
    # Writes the demonstrations of these ids, as text, in the order of the file, with all that it says of them. All of
    # them are there; so is the output, empty, where it is a folder.
    keep: Callable[[Path, Path, Set[str], ColumnOptions], object] | None = None
    # What `keep` writes no new file of, in words; empty where it writes one.
    unkept: Callable[[Path, ColumnOptions], str] = lambda *_: ""
    suffixes: tuple[str, ...] = ()  # extensions of its files; those that `write` writes have the first
    # Writes demonstrations to a path, and values (M,) for each or (N,) for each step by name.
    write: Callable[[Path, Demonstrations, Mapping[str, Array]], None] | None = None
    # What beside the demonstrations does not agree with them; with True, in videos too.
    find_defects: Callable[[Path, bool], list[Defect]] | None = None
    # Writes a copy to a new folder that says more of each demonstration: by the name of a column, values by id as text.
    annotate: Callable[[Path, Path, Mapping[str, Mapping[str, object]]], None] | None = None
    shots: Callable[[Path], Sequence[Shot]] | None = None  # where in video files each is seen; these need not be there


@dataclass(frozen=True, eq=False)
class Layout:
    """The arrays that columns make."""

    observations: Mapping[str, str]  # the columns, and how each is shown
    actions: Mapping[str, str]
    observation: np.dtype[np.generic]
    action: np.dtype[np.generic]
    n_parts: int  # of an action; 0 where actions are discrete, and where a single number may yet be
    order: Literal["F", "C"]  # of observations, as in the files, so that nothing is transposed
    allows_missing: bool  # whether numbers may be NaN or infinite
    action_kind: ActionKind  # as the user wants it

    @classmethod
    def of(cls, schema: pa.Schema, columns: Columns) -> Layout:
        """By the types of the columns."""
        seen, acted = columns.observations, columns.actions
        kinds = ({value_type(schema.field(name).type) for name in own} for own in (seen, acted))
        observation, action = (np.dtype(np.float32 if own == {np.dtype(np.float32)} else np.float64) for own in kinds)
        own_type, n_parts = value_type(schema.field(acted[0]).type), len(acted)
        of_list = next((parts for parts in columns.lists.values() if acted[0] in parts), ())
        may_be_class = columns.one_action and not (len(of_list) > 1 or (of_list and own_type.kind == "f"))
        if n_parts == 1 and (may_be_class or columns.options.action_kind == "discrete"):
            n_parts, action = 0, action if own_type.kind == "f" else own_type
        allows_missing = columns.options.allow_missing or columns.options.skip_bad is True
        order: Literal["F", "C"] = "C" if any(len({*parts} & {*seen}) > 1 for parts in columns.lists.values()) else "F"
        kind = columns.options.action_kind
        return cls(_shown(seen), _shown(acted), observation, action, n_parts, order, allows_missing, kind)

    def empty(self, n_steps: int) -> tuple[Array, Array]:
        """Uninitialised observations (n_steps, D) and actions, (n_steps,) or (n_steps, A)."""
        shape = (n_steps, self.n_parts) if self.n_parts else (n_steps,)
        return np.empty((n_steps, len(self.observations)), self.observation, self.order), np.empty(shape, self.action)

    def write(self, steps: Steps, first: int, observations: Array, actions: Array) -> None:
        """Write as many steps, from the `first` on, as the arrays have; a `DataError` where a value is no number."""
        for row, table, at in steps.tables([*self.actions, *self.observations], first, first + len(actions)):
            own = slice(row - first, row - first + len(table))
            with guarded(at(0)):
                self._fill(observations[own], table, self.observations, at)
                self._fill(actions[own].reshape(len(table), -1), table, self.actions, at)

    def _fill(self, out: Array, table: pa.Table, columns: Collection[str], at: Place) -> None:
        together: list[Array] = []
        for k, name in enumerate(columns, start=1):
            values = flat.column_values(table, name, at, self.allows_missing)
            if values.dtype.kind == "U" and out.dtype.kind != "U":
                row = next((row for row, text in enumerate(values) if not flat.is_number(text, ",")), 0)
                said = f"column {name!r} holds text ({str(values[row])[:40]!r}), not numbers"
                raise DataError(f"{at(row)}: {said}; write numbers, or leave the column out with --exclude.")
            together.append(values)
            if not k % 16 or k == len(columns):  # several at a time, as numbers of a row lie together
                out[:, k - len(together) : k], together = np.stack(together).T, []


def _shown(names: Sequence[str]) -> dict[str, str]:
    """How columns are shown: without the prefix of observations, unless two are alike then."""
    short = {name: short_name(name) or "0" for name in names}
    return short if len({*short.values()}) == len(names) else dict(zip(names, names, strict=True))


def value_type(kind: pa.DataType) -> np.dtype[np.generic]:
    """The type of NumPy of the values of a column: float32 or float64, int64 for whole numbers, or text."""
    if flat.kind_of_type(kind) == "text":
        return np.dtype(np.str_)
    kind = flat.plain_type(kind)
    if pa.types.is_float32(kind):
        return np.dtype(np.float32)
    return np.dtype(np.int64 if pa.types.is_integer(kind) or pa.types.is_boolean(kind) else np.float64)


@dataclass(frozen=True, eq=False)
class Shard:
    """Consecutive blocks of a data set. Iterating reads them from disk, one `Block` after another."""

    steps: Steps  # of the demonstrations ``bounds[0]`` .. ``bounds[-1] - 1``
    layout: Layout
    bounds: tuple[int, ...]  # number of the first demonstration of each block, and of the one after the last

    def __iter__(self) -> Iterator[Block]:
        steps, bounds = self.steps.offsets, np.array(self.bounds) - self.bounds[0]
        (groups,) = shard_bounds(steps[bounds] - steps[0], 1, BLOCK_STEPS)  # small blocks are read together
        for own in (bounds[a : b + 1] for a, b in itertools.pairwise(groups)):
            offsets = steps[own[0] : own[-1] + 1] - steps[own[0]]
            block = Block(self.bounds[0] + int(own[0]), *self.layout.empty(int(offsets[-1])), offsets)
            self.layout.write(self.steps, int(steps[own[0]]), block.observations, block.actions)
            yield from itertools.starmap(block.part, itertools.pairwise((own - own[0]).tolist()))


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
    steps : Steps
    layout : Layout
        The arrays that the columns make.
    classes : (K,) array
        The distinct actions, in order; empty where they are continuous.
    low, high : (A,) arrays
        Smallest and largest continuous actions.
    memory : int or str, optional
        Bytes that demonstrations in memory may take; by default half of the free memory.
    """

    ids: tuple[Id, ...]
    offsets: NDArray[np.int64]
    source: str
    steps: Steps
    layout: Layout
    classes: Array
    low: Array
    high: Array
    memory: Size | None = None

    @property
    def observation_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the D numbers of an observation."""
        return tuple(self.layout.observations.values())

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the parts of an action."""
        return tuple(self.layout.actions.values())

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
        bounds = shard_bounds(self.offsets, n_shards, block_steps)
        steps = replace(self.steps, place=None, sizes={})  # which grow with the data, and serve messages alone
        own = ((steps.ids[one[0] : one[-1]], steps.offsets[one[0] : one[-1] + 1], one) for one in bounds)
        return [Shard(replace(steps, ids=ids, offsets=rows), self.layout, tuple(one)) for ids, rows, one in own]

    def select(self, indices: Indices) -> Demonstrations:
        """The demonstrations at `indices` (integers, a slice or a mask over the M), in that order, in memory."""
        chosen = np.atleast_1d(np.arange(len(self))[indices])
        check_any(len(chosen), self.source)
        offsets = np.concatenate([[0], np.cumsum(self.lengths[chosen])])
        check_memory(self.nbytes * offsets[-1] / self.n_steps, self.source, self.memory)
        observations, actions = self.layout.empty(int(offsets[-1]))
        heads = np.flatnonzero(np.diff(chosen, prepend=-2) != 1)  # of runs of consecutive demonstrations
        for a, b, head in zip(offsets[heads], offsets[[*heads[1:], len(chosen)]], chosen[heads], strict=True):
            self.layout.write(self.steps, int(self.offsets[head]), observations[a:b], actions[a:b])
        kind: ActionKind = "discrete" if self.is_discrete else "continuous"
        names = self.observation_names, self.source, kind, self.action_names, self.layout.allows_missing
        return Demonstrations(observations, actions, offsets, tuple(self.ids[m] for m in chosen.tolist()), *names)
