"""One pass over the steps of a recording: the kind of the actions, ranges, missing values, idle columns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
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

    `missing`, `low`, `high` and `within`, (K,), say of each number of an action and an observation how often it is
    missing, its smallest and largest value, and whether it is the same within every demonstration.
    """

    layout: Layout  # afterwards with the type of the actions, and without the columns that are `left_out`
    kind: str = ""  # "discrete", "continuous" or, where actions cannot be what is wanted, "refused"
    reason: str = ""
    classes: Array = field(default_factory=lambda: np.empty(0))  # the different actions in order, if they are discrete
    fault: DataError | None = None  # of the first step whose action cannot be one
    left_out: dict[str, str] = field(default_factory=dict)  # columns that are no observations, and why by their values
    repeats: set[str] = field(default_factory=set)  # columns that repeat the action of the step before
    clocks: dict[str, float] = field(default_factory=dict)  # that grow by a constant, infinite before the first step
    faulty: set[int] = field(default_factory=set)  # demonstrations in which a value is missing or infinite
    _is_whole: bool = True
    _n_changes: int = 0

    def __post_init__(self) -> None:
        self._read = (*self.layout.actions, *self.layout.observations)
        n = sum(len(one.parts) for one in self._read)
        self.missing, self.within = np.zeros(n, int), np.ones(n, bool)
        self.low, self.high = np.full(n, np.nan), np.full(n, np.nan)

    def add(self, table: pa.Table, owners: Array, at: Place) -> None:
        """Add the steps of whole demonstrations, whose numbers the `owners` (N,) are."""
        same = owners[1:] == owners[:-1]
        read = {one.name: one.cut(flat.padded(table[one.name], one.width)) for one in self._read}
        values = np.concatenate([*read.values()], axis=1, dtype=float).T.copy()  # in which numbers are compared fast
        self.missing += np.isnan(values).sum(axis=1)
        self.low = np.fmin(self.low, np.fmin.reduce(values, axis=1))
        self.high = np.fmax(self.high, np.fmax.reduce(values, axis=1))
        self.within &= ((values[:, 1:] == values[:, :-1]) | ~same).all(axis=1)
        self.faulty.update(owners[~np.isfinite(values).all(axis=0)].tolist())
        for name in [*self.clocks] if same.any() else ():  # but for the rounding of its numbers
            now, then = (own[same] for own in (read[name][1:], read[name][:-1]))
            with np.errstate(invalid="ignore"):
                grown, rounding = np.subtract(now, then, dtype=float), 2 * np.spacing(np.abs(now).max())
                step = self.clocks[name] = min(self.clocks[name], float(grown[0, 0]))
                near = _ROUNDING * step + float(rounding)
                if not 4 * near < step < inf or not (np.abs(grown - step) <= near).all():
                    del self.clocks[name]
        actions = np.concatenate([read[one.name] for one in self.layout.actions], axis=1)
        before = actions[:-1][same]
        same_values = ((name, read[name][1:][same]) for name in self.repeats)
        with np.errstate(invalid="ignore"):  # actions of damaged files need not be whole
            self.repeats = {name for name, now in same_values if np.array_equal(now, before.astype(now.dtype))}
        self._n_changes += int((before != actions[1:][same]).any(axis=1).sum())
        if not self.layout.n_parts:
            self._add_action(table, at)

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
        kinds = [value_type(steps.table.schema.field(one.name).type).kind for one in self._read for _ in one.parts]
        self.low[np.array(kinds) == "U"] = np.nan  # texts have no range
        left = [one for one in self.layout.observations if one.name not in self.left_out]
        self.layout = layout = replace(self.layout, observations=tuple(left))
        if layout.n_parts:
            self._refuse_parts(steps.source, kinds)
            return
        is_text, wanted = layout.action.kind == "U", layout.action_kind
        try:
            self.kind, self.reason = action_kind(
                len(self.classes), len(steps), is_text, self._is_whole, wanted, steps.source
            )
        except DataError as error:
            self.kind, self.reason = "refused", error.in_shell.removeprefix(f"{steps.source}: ").rstrip(".")
            self.fault = self.fault or error
        if self.kind == "discrete":
            self.layout = replace(layout, action=self.classes.dtype)
        elif self.kind == "continuous":
            self.classes = np.empty(0)
            action = np.dtype(np.float32 if layout.action == np.float32 else np.float64)
            self.layout = replace(layout, action=action, n_parts=1)

    def _refuse_parts(self, source: str, kinds: Sequence[str]) -> None:
        """Refuse actions of several numbers or texts where not all are numbers, or they are to be discrete."""
        layout = self.layout
        texts = [part for part, kind in zip(layout.action_names, kinds, strict=False) if kind == "U"]
        if layout.n_parts == 1 or not (texts or layout.action_kind == "discrete"):
            parts = f"{layout.n_parts} numbers"
            self.kind, self.reason = "continuous", parts if layout.n_parts > 1 else "a column of a continuous action"
            return
        own = (texts, "text"), ([part for part in layout.action_names if part not in texts], "numbers")
        said = ", ".join(f"{commas(names)} ({what})" for names, what in own if names)
        self.kind, self.reason = "refused", f"the action has several parts: {said}"
        self.fault = DataError(f"{source}: {self.reason}; name the part to judge with <option>.", "action")

    def summary(self, steps: Steps) -> tuple[dict[str, tuple[float, float]], list[str], dict[str, int]]:
        """Smallest and largest of the numbers that are there; the observations that differ between demonstrations, and
        never within one; and how many values are missing by the column; without the columns that are left out."""
        ranges, constant, missing = dict[str, tuple[float, float]](), set[str](), Counter[str]()
        names = [(one.name, part) for one in self._read for part in one.parts]
        stacked = np.stack([self.low, self.high, self.within, self.missing], axis=1).tolist()
        for (column, part), (low, high, within, n) in zip(names, stacked, strict=True):
            if column not in self.left_out:
                missing[column] += int(n)
                ranges |= {part: (low, high)} if low == low else {}
                constant |= {part} if within and low < high and len(steps.ids) < len(steps) else set()
        observed = [name for name in self.layout.observation_names if name in constant]
        return ranges, observed, {column: n for column, n in missing.items() if n}


def scan(steps: Steps, layout: Layout, columns: Columns) -> Scan:
    """Read all steps once."""
    found, lengths = Scan(layout), np.diff(steps.offsets)
    if not columns.options.observations:
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
    return found
