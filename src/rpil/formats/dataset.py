"""The arrays that columns make, and `Dataset`: demonstrations whose rows are read block by block in every pass."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import Literal, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rpil.data.arrays import ActionKind, Id, Indices, check_any, check_finite
from rpil.data.demonstrations import BLOCK_STEPS, Block, Demonstrations, DemonstrationSet, shard_bounds
from rpil.data.errors import DataError
from rpil.data.guard import guarded
from rpil.data.memory import Size, check_memory
from rpil.data.names import quoted, short_name
from rpil.formats import table as flat
from rpil.formats.columns import Columns
from rpil.formats.steps import Steps
from rpil.formats.table import Place
from rpil.numerics.types import Array


class Column(NamedTuple):
    """A column that is read: the names of the numbers that are, and which they are of all that a row has."""

    name: str
    parts: tuple[str, ...]
    mask: Array | None = None  # where not all are read

    @property
    def width(self) -> int:
        """The numbers that a row has."""
        return len(self.parts if self.mask is None else self.mask)

    def cut(self, values: Array) -> Array:
        """The values (N, K) that are read; all where rows have more or fewer than there should be."""
        return values if self.mask is None or values.shape[1:] != self.mask.shape else values[:, self.mask]


@dataclass(frozen=True, eq=False)
class Layout:
    """The arrays that columns make."""

    observations: tuple[Column, ...]
    actions: tuple[Column, ...]
    observation: np.dtype[np.generic]
    action: np.dtype[np.generic]
    n_parts: int  # of an action; 0 where actions are discrete, and where a single number may yet be
    left_out: Mapping[str, str]  # names of the numbers in lists that are not read, and why
    allows_missing: bool  # whether numbers may be NaN or infinite
    action_kind: ActionKind  # as the user wants it

    @classmethod
    def of(cls, table: pa.Table, columns: Columns, joints: Mapping[str, Sequence[str]]) -> Layout:
        """By the types of the columns, and the first lists in them; `joints` name the numbers of a list."""
        observations, actions, left_out = _chosen(table, columns, joints)
        if not actions or not observations:
            what = "action" if observations else "observations"
            raise DataError(f"{columns.source}: <option> leaves nothing of the {what}; correct it.", "exclude")
        kinds = ({value_type(table[one.name].type) for one in own} for own in (observations, actions))
        observation, action = (np.dtype(np.float32 if own == {np.dtype(np.float32)} else np.float64) for own in kinds)
        first, n_parts = actions[0], sum(len(one.parts) for one in actions)
        own_type = value_type(table[first.name].type)
        is_list_of_floats = own_type.kind == "f" and flat.kind_of_type(table[first.name].type) == "list"
        may_be_class = columns.one_action and first.mask is None and not is_list_of_floats
        if n_parts == 1 and (may_be_class or columns.options.action_kind == "discrete"):
            n_parts, action = 0, action if own_type.kind == "f" else own_type
        allows_missing = columns.options.allow_missing or columns.options.skip_bad is True
        asked = allows_missing, columns.options.action_kind
        return cls(observations, actions, observation, action, n_parts, left_out, *asked)

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the D numbers of an observation."""
        return tuple(part for one in self.observations for part in one.parts)

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the numbers of an action."""
        return tuple(part for one in self.actions for part in one.parts)

    @property
    def columns(self) -> list[str]:
        """The columns that are read."""
        return [one.name for one in (*self.actions, *self.observations)]

    def empty(self, n_steps: int) -> tuple[Array, Array]:
        """Uninitialised observations (n_steps, D) and actions, (n_steps,) or (n_steps, A)."""
        # As in the files, so that nothing is transposed.
        order: Literal["F", "C"] = "C" if any(len(one.parts) > 1 for one in self.observations) else "F"
        shape = (n_steps, self.n_parts) if self.n_parts else (n_steps,)
        return np.empty((n_steps, len(self.observation_names)), self.observation, order), np.empty(shape, self.action)

    def write(self, steps: Steps, first: int, observations: Array, actions: Array) -> None:
        """Write steps from the `first` one on to two arrays, which say how many; a `DataError` where a value is missing
        or of the wrong kind."""
        for row, table, at in steps.tables(self.columns, first, first + len(actions)):
            own = slice(row - first, row - first + len(table))
            with guarded(at(0)):
                self._fill(observations[own], table, self.observations, at)
                self._fill(actions[own].reshape(len(table), -1), table, self.actions, at)

    def _fill(self, out: Array, table: pa.Table, columns: Sequence[Column], at: Place) -> None:
        start = 0
        for one in columns:
            block = flat.column_values(table, one.name, at, self.allows_missing)
            if block.dtype.kind == "U" and out.dtype.kind != "U":
                row = next((row for row, text in enumerate(block) if not flat.is_number(text)), 0)
                said = (
                    f"holds text ({str(block[row])[:40]!r}), not numbers; write numbers, or leave the column out with"
                )
                raise DataError(f"{at(row)}: column {one.name!r} {said} <option>.", "exclude")
            block = block.reshape(len(block), -1)
            if block.shape[1] != one.width:
                fault = f"holds {block.shape[1]} numbers, not {one.width} as elsewhere"
                raise DataError(f"{at(0)}: column {one.name!r} {fault}.")
            out[:, start : start + len(one.parts)] = one.cut(block)
            start += len(one.parts)


def _chosen(
    table: pa.Table, columns: Columns, joints: Mapping[str, Sequence[str]]
) -> tuple[tuple[Column, ...], tuple[Column, ...], dict[str, str]]:
    """The columns of observations, and of actions, of which a number is read, and why other numbers are not.

    A `DataError` where a name that the user gave is that of no column and of no part.
    """
    left_out, known, found, excluded = dict[str, str](), list[str](), list[tuple[Column, ...]](), columns.excluded_parts
    unknown = dict.fromkeys(pattern for patterns in columns.chosen_parts.values() for pattern in patterns)
    unknown |= {pattern: None for pattern, is_known in excluded.items() if not is_known}

    def is_named(part: str, column: str, patterns: Iterable[str]) -> bool:
        """Whether one of the `patterns` names a number, with the column's whole name or its short one."""
        spellings = {part.lower(), f"{column}.{part.removeprefix(short_name(column)).lstrip('.')}".lower()}
        hits = [pattern for pattern in patterns if any(fnmatchcase(text, pattern.lower()) for text in spellings)]
        for pattern in hits:
            unknown.pop(pattern, None)
        return bool(hits)

    for names in (columns.observations, columns.actions):
        lists = [name for name in names if flat.kind_of_type(table[name].type) == "list"]
        rows = {name: next((row for row in table[name] if row.is_valid), [None]) for name in lists}
        widths, own, first = {name: len(rows.get(name, [None])) for name in names}, list[Column](), 0
        parts = flat.part_names(widths, joints)
        known += parts
        for name, width in widths.items():
            these, patterns = parts[first : first + width], columns.chosen_parts.get(name)
            first += width
            without = {part for part in these if is_named(part, name, excluded)}
            wanted = {part for part in these if patterns is None or is_named(part, name, patterns)}
            read = tuple(part for part in these if part in wanted and (part not in without or width == 1))
            why = ("not among those named", "excluded as asked")
            left_out |= {part: why[part in without] for part in these if part not in read}
            if read or not these:
                own.append(Column(name, read, None if len(read) == width else np.isin(these, read)))
        found.append(tuple(own))
    for pattern in unknown:
        close = get_close_matches(pattern, known, 3) or known
        raise DataError(
            f"{columns.source}: no column, nor a number in one, is called {pattern!r}; correct <option>, <option> or "
            f"<option> (found {quoted(close)}).",
            ("exclude", "observations", "action"),
        )
    return found[0], found[1], left_out


def value_type(kind: pa.DataType) -> np.dtype[np.generic]:
    """The type of NumPy of the values of a column: float32 or float64, int64 for whole numbers, or text."""
    if flat.kind_of_type(kind) == "text":
        return np.dtype(np.str_)
    kind = flat.plain_type(kind)
    if flat.kind_of_type(kind) == "list":
        kind = kind.value_type
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
