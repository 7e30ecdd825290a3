"""One pass over the steps of a recording: the kind of the actions, ranges, missing values, idle columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from math import inf

import numpy as np
import pyarrow as pa

from rpil.data.arrays import MAX_CLASSES, action_kind, are_whole, as_actions
from rpil.data.demonstrations import BLOCK_STEPS, shard_bounds
from rpil.data.errors import DataError
from rpil.formats import table as flat
from rpil.formats.columns import TIME_OF_STEP, Columns
from rpil.formats.dataset import Layout, value_type
from rpil.formats.description import commas
from rpil.formats.steps import Steps
from rpil.formats.table import Place
from rpil.numerics.types import Array

_FEW_STEPS = 10  # changes of the action, to see that a column repeats the last one
_ROUNDING = 1e-3  # of the steps of a time, as texts round them


@dataclass(eq=False)
class Scan:
    """What the steps hold. Ranges are computed from values: pyarrow crashes on damaged Parquet statistics.

    Attributes
    ----------
    layout : Layout
        Afterwards with the type of the actions, and without the columns that are `left_out`.
    kind, reason : str
        "discrete", "continuous" or, where actions cannot be what is wanted, "refused", and why.
    classes : array
        The different actions in order, if they are discrete.
    fault : DataError, optional
        Of the first step whose action cannot be one.
    left_out : dict of str to str
        Columns that were to be observations, and why their values are none: the last action, or a time.
    repeats, clocks : set of str, dict of str to float
        Columns of observations that may be left out: that repeat the action of the step before, and that grow by a
        constant in every step, which is infinite before the first.
    missing : dict of str to int
        Missing values by column.
    low, high : dict of str to array
        Smallest and largest of the numbers (K,) of a column.
    within : dict of str to array
        Whether each number of a column is the same within every demonstration, (K,).
    faulty : set of int
        Numbers of the demonstrations in which a value is missing or infinite.
    """

    layout: Layout
    kind: str = ""
    reason: str = ""
    classes: Array = field(default_factory=lambda: np.empty(0))
    fault: DataError | None = None
    left_out: dict[str, str] = field(default_factory=dict)
    repeats: set[str] = field(default_factory=set)
    clocks: dict[str, float] = field(default_factory=dict)
    missing: dict[str, int] = field(default_factory=dict)
    low: dict[str, Array] = field(default_factory=dict)
    high: dict[str, Array] = field(default_factory=dict)
    within: dict[str, Array] = field(default_factory=dict)
    faulty: set[int] = field(default_factory=set)
    _is_whole: bool = True
    _n_changes: int = 0

    def add(self, table: pa.Table, owners: Array, at: Place) -> None:
        """Add the steps of whole demonstrations, whose numbers the `owners` (N,) are."""
        same, read = owners[1:] == owners[:-1], {}
        for one in (*self.layout.actions, *self.layout.observations):
            name, values, low = one.name, flat.numbers_or_missing(table[one.name]), self.low.get(one.name)
            values = None if values is None else one.cut(values)
            n_missing = table[name].null_count if values is None else int(np.isnan(values).sum())
            if n_missing:
                self.missing[name] = self.missing.get(name, 0) + n_missing
            if values is None or (low is not None and len(low) != values.shape[1]):
                faulty = flat.faulty_rows(table[name], None if low is None else len(low), one.mask)
                self.faulty.update(owners[faulty].tolist())
                self.clocks.pop(name, None)
            elif values.size:
                self._add(name, values, same)
                read[name] = values
                if n_missing or not np.isfinite([self.low[name], self.high[name]]).all():
                    self.faulty.update(owners[~np.isfinite(values).all(axis=1)].tolist())
        self._compare(read, same)
        if not self.layout.n_parts:
            self._add_action(table, at)

    def _add(self, name: str, values: Array, same: Array) -> None:
        columns = np.ascontiguousarray(values.T)  # in which numbers are compared fast
        low, high = np.fmin.reduce(columns, axis=1), np.fmax.reduce(columns, axis=1)
        self.low[name] = np.fmin(self.low.get(name, low), low)
        self.high[name] = np.fmax(self.high.get(name, high), high)
        within = self.within.get(name, np.ones(len(columns), dtype=bool))
        if within.any():
            within = within & ((columns[:, 1:] == columns[:, :-1]) | ~same).all(axis=1)
        self.within[name] = within
        if name in self.clocks and same.any():  # strike out what does not grow by its constant, but for rounding
            with np.errstate(invalid="ignore"):
                grown = np.subtract(values[1:], values[:-1], dtype=float)[same]
                step = self.clocks[name] = min(self.clocks[name], float(grown[0, 0]))
                near = _ROUNDING * step + float(2 * np.spacing(np.abs(values[1:][same]).max()))
                if not 4 * near < step < inf or not (np.abs(grown - step) <= near).all():
                    del self.clocks[name]

    def _compare(self, read: Mapping[str, Array], same: Array) -> None:
        """Strike out `repeats` in which a step, that begins no demonstration, differs from the action before it."""
        names = [one.name for one in self.layout.actions]
        if not self.repeats.issubset(read) or not read.keys() >= {*names}:
            self.repeats = set()
        if self.repeats:
            actions = np.concatenate([read[name] for name in names], axis=1)
            before = actions[:-1][same]
            same_values = ((name, read[name][1:][same]) for name in self.repeats)
            with np.errstate(invalid="ignore"):  # actions of damaged files need not be whole
                self.repeats = {name for name, now in same_values if np.array_equal(now, before.astype(now.dtype))}
            self._n_changes += int((before != actions[1:][same]).any(axis=1).sum())

    def _add_action(self, table: pa.Table, at: Place) -> None:
        """Add the actions of one column, but for those that are missing."""
        (one,), layout = self.layout.actions, self.layout
        try:
            values = flat.column_values(table, one.name, at, layout.allows_missing)
        except DataError as error:
            self.fault, table = self.fault or error, table.select([one.name]).drop_null()
            values = flat.column_values(table, one.name, at) if len(table) else np.empty(0)
        values = one.cut(values).reshape(-1)
        if values.dtype.kind == "f":
            finite = np.isfinite(values)
            if not finite.all():
                said = f"{at(int(np.argmin(finite)))}: an action is not finite; repair it, or read with <option>."
                self.fault = self.fault or DataError(said, "skip_bad")
            values = values[~np.isnan(values)]
            self._is_whole = self._is_whole and are_whole(values)
        wants_all = layout.action.kind == "U" or layout.action_kind == "discrete"
        if self._is_whole and (wants_all or len(self.classes) <= MAX_CLASSES):
            own = np.unique(as_actions(values, at(0), "discrete"))
            self.classes = np.union1d(self.classes, own) if len(self.classes) else own

    def finish(self, steps: Steps) -> None:
        """Decide what the actions are, and leave out `repeats`, if enough changes tell, and `clocks`, unless no other
        observation is left."""
        repeats = sorted(self.repeats) if self._n_changes >= _FEW_STEPS else []
        found = dict.fromkeys(repeats, "it repeats the last action") | dict.fromkeys(self.clocks, TIME_OF_STEP)
        self.left_out = found if len(found) < len(self.layout.observations) else {}
        self.missing = {name: n for name, n in self.missing.items() if name not in self.left_out}
        left = [one for one in self.layout.observations if one.name not in self.left_out]
        self.layout = layout = replace(self.layout, observations=tuple(left))
        if layout.n_parts:
            self._refuse_parts(steps)
            return
        is_text, wanted = layout.action.kind == "U", layout.action_kind
        try:
            self.kind, self.reason = action_kind(len(self.classes), len(steps), is_text, self._is_whole, wanted, "")
        except DataError as error:
            self.kind, self.reason = "refused", str(error).removeprefix(": ").rstrip(".")
            self.fault = self.fault or DataError(f"{steps.source}{error}")
        if self.kind == "discrete":
            self.layout = replace(layout, action=self.classes.dtype)
        elif self.kind == "continuous":
            self.classes = np.empty(0)
            action = np.dtype(np.float32 if layout.action == np.float32 else np.float64)
            self.layout = replace(layout, action=action, n_parts=1)

    def _refuse_parts(self, steps: Steps) -> None:
        """Refuse actions of several numbers or texts where not all are numbers, or they are to be discrete."""
        layout, schema = self.layout, steps.table.schema
        kinds = {part: value_type(schema.field(one.name).type).kind for one in layout.actions for part in one.parts}
        texts = [part for part, kind in kinds.items() if kind == "U"]
        if layout.n_parts == 1 or not (texts or layout.action_kind == "discrete"):
            parts = f"{layout.n_parts} numbers"
            self.kind, self.reason = "continuous", parts if layout.n_parts > 1 else "a column of a continuous action"
            return
        own = (texts, "text"), ([part for part in kinds if part not in texts], "numbers")
        said = ", ".join(f"{commas(names)} ({what})" for names, what in own if names)
        self.kind, self.reason = "refused", f"the action has several parts: {said}"
        self.fault = DataError(f"{steps.source}: {self.reason}; name the part to judge with <option>.", "action")

    @property
    def action_range(self) -> tuple[Array, Array]:
        """Smallest and largest continuous actions, (A,) each."""
        names = [one.name for one in self.layout.actions]
        low, high = ([ends.get(name, np.full(1, np.nan)) for name in names] for ends in (self.low, self.high))
        return np.concatenate(low, dtype=float), np.concatenate(high, dtype=float)

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest of the numbers that are there."""
        there = [one for one in (*self.layout.actions, *self.layout.observations) if one.name in self.low]
        found = ((one.parts, self.low[one.name].tolist(), self.high[one.name].tolist()) for one in there)
        return {name: (a, b) for parts in found for name, a, b in zip(*parts, strict=True) if a == a}

    def constant(self) -> list[str]:
        """Names of the numbers of observations that differ between demonstrations, and never within one."""
        own = [one for one in self.layout.observations if one.name in self.within]
        found = ((one.parts, self.within[one.name] & (self.low[one.name] < self.high[one.name])) for one in own)
        return [name for parts, are in found for name, is_one in zip(parts, are, strict=True) if is_one]


def scan(steps: Steps, layout: Layout, columns: Columns) -> Scan:
    """Read all steps once."""
    found, lengths = Scan(layout), np.diff(steps.offsets)
    if not columns.observations_given:
        widths = {one.name: len(one.parts) for one in layout.observations}
        found.repeats = {name for name, width in widths.items() if width == max(layout.n_parts, 1)}
        if lengths.max(initial=1) > 2:  # any two numbers differ by a constant
            found.clocks = dict.fromkeys((name for name, width in widths.items() if width == 1), inf)
    (bounds,) = shard_bounds(steps.offsets, 1, BLOCK_STEPS)
    for first, end in pairwise(bounds):
        rows = slice(int(steps.offsets[first]), int(steps.offsets[end]))
        owners = np.repeat(np.arange(first, end), lengths[first:end])
        found.add(steps.read(layout.columns, rows), owners, partial(steps.place_of, rows.start))
    found.finish(steps)
    if lengths.max(initial=1) < 2:  # no demonstration has a second step
        found.within.clear()
    return found
