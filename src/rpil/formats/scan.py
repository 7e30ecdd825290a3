"""One pass over the rows of a recording: the kind of the actions, ranges, missing values, operators and tasks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from rpil.data.arrays import MAX_CLASSES, ActionKind, action_kind, are_whole, as_actions
from rpil.data.errors import DataError
from rpil.formats import table as flat
from rpil.formats.columns import TIME_OF_STEP, Columns
from rpil.formats.dataset import Column, Layout, value_type
from rpil.formats.description import commas
from rpil.formats.places import Places
from rpil.formats.rows import Rows
from rpil.formats.table import Place
from rpil.formats.table_facts import pairs_of
from rpil.numerics.types import Array


class FoundActions(NamedTuple):
    """What actions are: "discrete", "continuous" or, where they cannot be what is wanted, "refused", and why; their
    `layout`, the different ones in order, if they are discrete, and the `fault` of the first that cannot be one."""

    layout: Layout
    kind: str
    reason: str
    classes: Array = np.empty(0)
    fault: DataError | None = None


def find_actions(rows: Rows, layout: Layout, wanted: ActionKind, source: str, places: Places) -> FoundActions:
    """What the actions of all rows are."""
    if layout.n_parts:
        return _of_parts(rows, layout, wanted, source)
    is_text = layout.action.kind == "U"
    classes, is_whole, fault = np.empty(0), True, None
    for values, at, wrong in _single_actions(rows, layout, places):
        fault = fault or wrong
        is_whole = is_whole and (values.dtype.kind != "f" or are_whole(values))
        if is_whole and (is_text or wanted == "discrete" or len(classes) <= MAX_CLASSES):
            own = np.unique(as_actions(values, at(0), "discrete"))
            classes = np.union1d(classes, own) if len(classes) else own
    try:
        kind, reason = action_kind(len(classes), len(rows), is_text, is_whole, wanted, "")
    except DataError as error:
        said = str(error).removeprefix(": ").rstrip(".")
        return FoundActions(layout, "refused", said, classes, fault or DataError(f"{source}{error}"))
    if kind == "discrete":
        return FoundActions(replace(layout, action=classes.dtype), kind, reason, classes, fault)
    action = np.dtype(np.float32 if layout.action == np.float32 else np.float64)
    return FoundActions(replace(layout, action=action, n_parts=1), kind, reason, fault=fault)


def _single_actions(rows: Rows, layout: Layout, places: Places) -> Iterator[tuple[Array, Place, DataError | None]]:
    """The actions of one column, table by table, but for those that are missing, and the first error in a table."""
    (one,) = layout.actions
    for _, table, at in rows.tables(0, len(rows), [one.name], places.demonstration_of):
        fault = None
        try:
            values = flat.column_values(table, one.name, at, layout.allows_missing)
        except DataError as error:
            fault, table = error, table.drop_null()
            values = flat.column_values(table, one.name, at) if len(table) else np.empty(0)
        values = one.cut(values).reshape(-1)
        if values.dtype.kind == "f":
            finite = np.isfinite(values)
            if not finite.all():
                said = f"{at(int(np.argmin(finite)))}: an action is not finite; repair it, or read with <option>."
                fault = fault or DataError(said, "skip_bad")
            values = values[~np.isnan(values)]
        yield values, at, fault


def _of_parts(rows: Rows, layout: Layout, wanted: ActionKind, source: str) -> FoundActions:
    """The actions of several numbers or texts, which are refused where not all are numbers, or are to be discrete."""
    schema = rows.table.schema
    kinds = {part: value_type(schema.field(one.name).type).kind for one in layout.actions for part in one.parts}
    texts = [part for part, kind in kinds.items() if kind == "U"]
    if layout.n_parts == 1 or not (texts or wanted == "discrete"):
        reason = "a column of a continuous action" if layout.n_parts == 1 else f"{layout.n_parts} numbers"
        return FoundActions(layout, "continuous", reason)
    own = (texts, "text"), ([part for part in kinds if part not in texts], "numbers")
    reason = f"the action has several parts: {', '.join(f'{commas(names)} ({what})' for names, what in own if names)}"
    fault = DataError(f"{source}: {reason}; name the part to judge with <option>.", "action")
    return FoundActions(layout, "refused", reason, fault=fault)


_FEW_STEPS = 10  # changes of the action, to see that a column repeats the last one
_ROUNDING = 1e-3  # of the steps of a time, as texts round them


@dataclass(eq=False)
class ScannedColumns:
    """Ranges, missing values and constant parts of the columns of data, collected table by table.

    Computed from values: pyarrow crashes on damaged Parquet statistics.

    Attributes
    ----------
    columns : dict of str to Column
        All columns of data.
    actions : sequence of str
    repeats : set of str
        Columns of observations, as wide as the action, that repeat the action of the step before.
    clocks : dict of str to float
        Columns of one number that grow by this constant in every step, which is infinite before the first.
    missing : dict of str to int
        Missing values by column.
    low, high : dict of str to array
        Smallest and largest of the numbers (K,) of a column.
    faulty : set of int
        Numbers of the demonstrations in which a value is missing or infinite.
    """

    columns: dict[str, Column]
    actions: Sequence[str]
    repeats: set[str] = field(default_factory=set)
    clocks: dict[str, float] = field(default_factory=dict)
    missing: dict[str, int] = field(default_factory=dict)
    low: dict[str, Array] = field(default_factory=dict)
    high: dict[str, Array] = field(default_factory=dict)
    faulty: set[int] = field(default_factory=set)
    _n_begun: int = 0
    _last: dict[str, Array] = field(default_factory=dict)
    _within: dict[str, Array] = field(default_factory=dict)
    _always: dict[str, Array] = field(default_factory=dict)
    _goes_on: bool = False
    _action: Array | None = None
    _n_changes: int = 0

    def add(self, table: pa.Table, begins: Array) -> None:
        """Add a table, in which demonstrations begin at the rows `begins`."""
        same = np.ones(len(table), dtype=bool)
        same[begins] = False
        owners = self._n_begun - 1 + np.cumsum(~same)
        read = {}
        for name, column in self.columns.items():
            values, before = flat.numbers_or_missing(table[name]), self.low.get(name)
            values = None if values is None else column.cut(values)
            n_missing = table[name].null_count if values is None else int(np.isnan(values).sum())
            if n_missing:
                self.missing[name] = self.missing.get(name, 0) + n_missing
            if values is None or (before is not None and len(before) != values.shape[1]):
                faulty = flat.faulty_rows(table[name], None if before is None else len(before), column.mask)
                self.faulty.update(owners[faulty].tolist())
                self.clocks.pop(name, None)
            elif values.size:
                self._add(name, values, same)
                read[name] = values
                if n_missing or not np.isfinite([self.low[name], self.high[name]]).all():
                    self.faulty.update(owners[~np.isfinite(values).all(axis=1)].tolist())
        self._n_begun += len(begins)
        if len(table):
            self._compare(read, same)
        self._goes_on = self._goes_on or bool(same.any())

    def _compare(self, read: Mapping[str, Array], same: Array) -> None:
        """Strike out `repeats` in which a step, that begins no demonstration, differs from the action before it."""
        if not self.repeats.issubset(read) or not read.keys() >= {*self.actions}:
            self.repeats = set()
        if self.repeats:
            actions = np.concatenate([read[name] for name in self.actions], axis=1)
            before = np.concatenate([actions[:1] if self._action is None else self._action, actions[:-1]])[same]
            same_values = ((name, read[name][same]) for name in self.repeats)
            with np.errstate(invalid="ignore"):  # actions of damaged files need not be whole
                self.repeats = {name for name, now in same_values if np.array_equal(now, before.astype(now.dtype))}
            self._n_changes += int((before != actions[same]).any(axis=1).sum())
            self._action = actions[-1:]

    def leave_out(self, n_observations: int) -> dict[str, str]:
        """Forget `repeats`, if enough changes tell, and `clocks`, unless no other is left; these columns, and why."""
        repeats = sorted(self.repeats) if self._n_changes >= _FEW_STEPS else []
        found = dict.fromkeys(repeats, "it repeats the last action") | dict.fromkeys(self.clocks, TIME_OF_STEP)
        if len(found) == n_observations:
            return {}
        self.columns = {name: one for name, one in self.columns.items() if name not in found}
        self.missing = {name: n for name, n in self.missing.items() if name not in found}
        return found

    def _add(self, name: str, values: Array, same: Array) -> None:
        columns = np.ascontiguousarray(values.T)  # in which numbers are compared fast
        low, high = np.fmin.reduce(columns, axis=1), np.fmax.reduce(columns, axis=1)
        if name in self.low:
            low, high = np.fmin(self.low[name], low), np.fmax(self.high[name], high)
        self.low[name], self.high[name] = low, high
        is_constant = np.ones(values.shape[1], dtype=bool)
        within, always = self._within.get(name, is_constant), self._always.get(name, is_constant)
        if within.any() or name in self.clocks:  # and else no column is always the same either
            before = np.concatenate([self._last.get(name, values[:1]), values[:-1]])
            if name in self.clocks and same.any():
                self._follow_clock(name, values[same], before[same])
            repeats = values == before
            within, always = within & repeats[same].all(axis=0), always & repeats.all(axis=0)
        self._within[name], self._always[name], self._last[name] = within, always, values[-1:]

    def _follow_clock(self, name: str, values: Array, before: Array) -> None:
        """Strike out a clock that does not grow by its constant, but for the rounding of its numbers."""
        with np.errstate(invalid="ignore"):
            grown, rounding = np.subtract(values, before, dtype=float), 2 * np.spacing(np.abs(values).max())
            step = self.clocks[name] = min(self.clocks[name], float(grown[0, 0]))
            near = _ROUNDING * step + float(rounding)
            if not 4 * near < step < inf or not (np.abs(grown - step) <= near).all():
                del self.clocks[name]

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest of the numbers that are there."""
        there = ((one.parts, name) for name, one in self.columns.items() if name in self.low)
        found = ((parts, self.low[name].tolist(), self.high[name].tolist()) for parts, name in there)
        return {name: (a, b) for parts in found for name, a, b in zip(*parts, strict=True) if a == a}

    def constant(self) -> list[str]:
        """Names of the numbers of observations that differ between demonstrations, and never within one."""
        own = [m for m in self.columns if self._goes_on and m in self._within and m not in self.actions]
        found = ((self.columns[m].parts, (self._within[m] & ~self._always[m]).tolist()) for m in own)
        return [name for parts in found for name, is_constant in zip(*parts, strict=True) if is_constant]


@dataclass(frozen=True, eq=False)
class Scan:
    """What one pass over the rows of a recording finds; pairs are of an id, as text, and an operator or a task."""

    places: Places
    layout: Layout
    asked: Layout
    """That of all columns, before anything was found."""
    actions: FoundActions
    statistics: ScannedColumns
    operators: list[tuple[str, object]]
    tasks: list[tuple[str, object]]
    left_out: Mapping[str, str]
    """Columns that were to be observations, and why their values are none: the last action, or a time."""

    @property
    def action_range(self) -> tuple[Array, Array]:
        """Smallest and largest continuous actions, (A,) each."""
        names, columns = self.statistics.actions, self.statistics
        low, high = ([ends.get(name, np.full(1, np.nan)) for name in names] for ends in (columns.low, columns.high))
        return np.concatenate(low, dtype=float), np.concatenate(high, dtype=float)


def scan(rows: Rows, layout: Layout, columns: Columns, source: str, places: Places) -> Scan:
    """Read all rows once."""
    actions = find_actions(rows, layout, columns.action_kind, source, places)
    given = {one.name: one for one in (*layout.actions, *layout.observations)}
    statistics = ScannedColumns(given, [one.name for one in layout.actions])
    if not columns.observations_given:
        widths = {one.name: len(one.parts) for one in layout.observations}
        statistics.repeats = {name for name, width in widths.items() if width == max(layout.n_parts, 1)}
        if np.diff(places.offsets).max(initial=1) > 2:  # any two numbers differ by a constant
            statistics.clocks = dict.fromkeys((name for name, width in widths.items() if width == 1), inf)
    for row, table, _ in rows.tables(0, len(rows), layout.columns):
        statistics.add(table, places.begins(row, len(table)))
    operators, tasks = (pairs_of(rows, name, places) for name in (columns.operator, columns.task))
    left_out = statistics.leave_out(len(layout.observations))
    return Scan(places, actions.layout.without(left_out), layout, actions, statistics, operators, tasks, left_out)
