"""The arrays that columns make, and `Dataset`: demonstrations whose rows are read block by block in every pass."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rpil.data.arrays import ActionKind, Id, Indices, check_any, check_finite
from rpil.data.demonstrations import BLOCK_STEPS, Block, Demonstrations, DemonstrationSet, shard_bounds
from rpil.data.errors import DataError, guarded
from rpil.data.memory import Size, check_memory
from rpil.data.names import short_name
from rpil.formats import table as flat
from rpil.formats.columns import Columns
from rpil.formats.steps import Steps
from rpil.formats.table import Place
from rpil.numerics.types import Array


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
        has_lists = any(len({*parts} & {*seen}) > 1 for parts in columns.lists.values())
        allows_missing = columns.options.allow_missing or columns.options.skip_bad is True
        order: Literal["F", "C"] = "C" if has_lists else "F"
        kind = columns.options.action_kind
        return cls(_shown(seen), _shown(acted), observation, action, n_parts, order, allows_missing, kind)

    @property
    def columns(self) -> list[str]:
        """The columns that are read."""
        return [*self.actions, *self.observations]

    def empty(self, n_steps: int) -> tuple[Array, Array]:
        """Uninitialised observations (n_steps, D) and actions, (n_steps,) or (n_steps, A)."""
        shape = (n_steps, self.n_parts) if self.n_parts else (n_steps,)
        return np.empty((n_steps, len(self.observations)), self.observation, self.order), np.empty(shape, self.action)

    def write(self, steps: Steps, first: int, observations: Array, actions: Array) -> None:
        """Write steps from the `first` one on to two arrays, which say how many; a `DataError` where a value is missing
        or of the wrong kind."""
        for row, table, at in steps.tables(self.columns, first, first + len(actions)):
            own = slice(row - first, row - first + len(table))
            with guarded(at(0)):
                self._fill(observations[own], table, self.observations, at)
                self._fill(actions[own].reshape(len(table), -1), table, self.actions, at)

    def _fill(self, out: Array, table: pa.Table, columns: Collection[str], at: Place) -> None:
        together: list[Array] = []
        for k, name in enumerate(columns, start=1):
            values = flat.column_values(table, name, at, self.allows_missing)
            if values.dtype.kind == "U" and out.dtype.kind != "U":
                row = next((row for row, text in enumerate(values) if not flat.is_number(text)), 0)
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

    @property
    def demonstrations(self) -> slice:
        """Numbers of its demonstrations."""
        return slice(self.bounds[0], self.bounds[-1])

    def __iter__(self) -> Iterator[Block]:
        for first, end in itertools.pairwise(self.bounds):
            offsets = self.steps.offsets[first - self.bounds[0] : end - self.bounds[0] + 1]
            block = Block(first, *self.layout.empty(int(offsets[-1] - offsets[0])), offsets - offsets[0])
            self.layout.write(self.steps, int(offsets[0]), block.observations, block.actions)
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
    steps : Steps
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
        return [Shard(steps.part(one[0], one[-1]), self.layout, tuple(one)) for one in bounds]

    def refuse_faulty(self, numbers: Iterable[int]) -> None:
        """A `DataError` where a value of the demonstrations of these numbers is missing or infinite."""
        for m in sorted(numbers):
            (block,) = Shard(self.steps.part(m, m + 1), self.layout, (m, m + 1))
            source = (self.steps.files(self.offsets[m : m + 1]) or [self.source])[0]
            names = [f"observation {name!r}" for name in self.observation_names]
            parts = [f"action {a}" for a in range(self.n_actions)]
            for values, what in ((block.observations, names), (block.actions, parts)):
                if what:
                    check_finite(values, tuple(what), block.offsets, self.ids[m : m + 1], source)

    def select(self, indices: Indices) -> Demonstrations:
        """The demonstrations at `indices` (integers, a slice or a mask over the M), in that order, in memory."""
        chosen = np.atleast_1d(np.arange(len(self))[indices])
        check_any(len(chosen), self.source)
        offsets = np.concatenate([[0], np.cumsum(self.lengths[chosen])])
        check_memory(self.nbytes * offsets[-1] / self.n_steps, self.source, self.memory)
        ids = tuple(self.ids[m] for m in chosen.tolist())
        observations, actions = self.layout.empty(int(offsets[-1]))
        heads = np.flatnonzero(np.diff(chosen, prepend=-2) != 1)  # of runs of consecutive demonstrations
        for a, b, head in zip(offsets[heads], offsets[[*heads[1:], len(chosen)]], chosen[heads], strict=True):
            self.layout.write(self.steps, int(self.offsets[head]), observations[a:b], actions[a:b])
        kind: ActionKind = "discrete" if self.is_discrete else "continuous"
        names = self.observation_names, self.source, kind, self.action_names, self.layout.allows_missing
        return Demonstrations(observations, actions, offsets, ids, *names)
