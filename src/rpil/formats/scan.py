"""One pass over the steps of a recording, its description, and words for what of it is damaged."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import groupby, pairwise
from math import inf
from typing import TypeVar

import numpy as np
import pyarrow as pa

from rpil.data.arrays import MAX_CLASSES, action_kind, are_whole, as_actions
from rpil.data.demonstrations import BLOCK_STEPS, shard_bounds
from rpil.data.errors import DamagedError, DataError
from rpil.data.text import counted, listed, quoted
from rpil.formats import table as flat
from rpil.formats.columns import TIME_OF_STEP, Columns
from rpil.formats.format import Layout, value_type
from rpil.formats.steps import Steps
from rpil.formats.table import Place
from rpil.numerics.types import Array

_FEW_STEPS = 10  # changes of the action, to see that a column repeats the last one
_ROUNDING = 1e-3  # of the steps of a time, as texts round them


@dataclass(eq=False)
class Scan:
    """Content of the steps. Ranges are computed from values: pyarrow crashes on damaged Parquet statistics.

    `missing`, `low`, `high` and `within`, (K,), say of each number of an action and an observation how often it is
    missing, its smallest and largest value, and whether it is the same within every demonstration.
    """

    layout: Layout  # afterwards with the type of the actions, and without the columns that are `left_out`
    kind: str = ""  # "discrete", "continuous" or, where actions cannot be what is wanted, "refused"
    reason: str = ""
    classes: Array = field(default_factory=lambda: np.empty(0))  # the different actions in order, if they are discrete
    fault: DataError | None = None  # of the first step whose action cannot be one
    left_out: dict[str, str] = field(default_factory=dict)  # columns that are no observations, and why by their values
    repeats: set[tuple[str, ...]] = field(default_factory=set)  # columns that repeat the action of the step before
    clocks: dict[str, float] = field(default_factory=dict)  # that grow by a constant, infinite before the first step
    faulty: set[int] = field(default_factory=set)  # demonstrations in which a value is missing or infinite
    _is_whole: bool = True
    _n_changes: int = 0

    def __post_init__(self) -> None:
        self._read = [*self.layout.actions, *self.layout.observations]
        self.missing, self.within = np.zeros(n := len(self._read), int), np.ones(n, bool)
        self.low, self.high = np.full((2, n), np.nan)

    def add(self, table: pa.Table, owners: Array, at: Place) -> None:
        """Add the steps of whole demonstrations, whose numbers the `owners` (N,) are."""
        same, read = owners[1:] == owners[:-1], dict[str, Array]()
        for name in self._read:
            found = flat.numbers_or_missing(table[name])
            is_null = table[name].is_null().to_numpy() if found is None else ()  # texts are 0 or NaN
            read[name] = np.where(is_null, np.nan, 0.0) if found is None else found
        kind = np.float32 if all(own.dtype == np.float32 for own in read.values()) else float
        values = np.stack([*read.values()], dtype=kind)  # in which numbers are compared fast
        low, high = values.min(axis=1), values.max(axis=1)
        if not np.isfinite([low, high]).all():
            self.missing += np.isnan(values).sum(axis=1)
            self.faulty.update(owners[~np.isfinite(values).all(axis=0)].tolist())
            low, high = np.fmin.reduce(values, axis=1), np.fmax.reduce(values, axis=1)
        self.low, self.high = np.fmin(self.low, low), np.fmax(self.high, high)
        for k in np.flatnonzero(self.within).tolist():
            self.within[k] = ((values[k, 1:] == values[k, :-1]) | ~same).all()
        for name in [*self.clocks] if same.any() else ():  # but for the rounding of its numbers
            now, then = (own[same] for own in (read[name][1:], read[name][:-1]))
            with np.errstate(invalid="ignore"):
                grown, rounding = np.subtract(now, then, dtype=float), 2 * np.spacing(np.abs(now).max())
                step = self.clocks[name] = min(self.clocks[name], float(grown[0]))
                near = _ROUNDING * step + float(rounding)
                if not 4 * near < step < inf or not (np.abs(grown - step) <= near).all():
                    del self.clocks[name]
        if self.repeats:
            actions = np.stack([read[name] for name in self.layout.actions], axis=1)
            before = actions[:-1][same]
            same_values = ((own, np.stack([read[name] for name in own], axis=1)[1:][same]) for own in self.repeats)
            with np.errstate(invalid="ignore"):  # actions of damaged files need not be whole
                self.repeats = {own for own, now in same_values if np.array_equal(now, before.astype(now.dtype))}
            self._n_changes += int((before != actions[1:][same]).any(axis=1).sum())
        if not self.layout.n_parts:
            self._add_action(table, at)

    def _add_action(self, table: pa.Table, at: Place) -> None:
        """Add the actions of one column, but for those that are missing."""
        (name,), layout = self.layout.actions, self.layout
        try:
            values = flat.column_values(table, name, at, layout.allows_missing)
        except DataError as error:
            self.fault, table = self.fault or error, table.select([name]).drop_null()
            values = flat.column_values(table, name, at) if len(table) else np.empty(0)
        if values.dtype.kind == "f":
            finite = np.isfinite(values)
            if not finite.all():
                said = f"{at(int(np.argmin(finite)))}: an action is not finite; repair it, or read with --skip-bad."
                self.fault = self.fault or DataError(said)
            values = values[~np.isnan(values)]
            self._is_whole = self._is_whole and are_whole(values)
        wants_all = layout.action.kind == "U" or layout.action_kind == "discrete"
        if self._is_whole and (wants_all or len(self.classes) <= MAX_CLASSES):
            own = np.unique(as_actions(values, at(0), "discrete"))
            self.classes = np.union1d(self.classes, own) if len(self.classes) else own

    def finish(self, steps: Steps) -> None:
        """Decide what the actions are, and leave out `repeats`, if enough changes tell, and `clocks`, but never all."""
        repeats = [name for own in sorted(self.repeats) for name in own] if self._n_changes >= _FEW_STEPS else []
        found = dict.fromkeys(repeats, "it repeats the last action") | dict.fromkeys(self.clocks, TIME_OF_STEP)
        self.left_out = found if len(found) < len(self.layout.observations) else {}
        kinds = [value_type(steps.table.schema.field(name).type).kind for name in self._read]
        self.low[np.array(kinds) == "U"] = np.nan  # texts have no range
        left = {name: shown for name, shown in self.layout.observations.items() if name not in self.left_out}
        self.layout = layout = replace(self.layout, observations=left)
        if layout.n_parts:  # of which all are to be numbers
            texts = [part for part, kind in zip(layout.actions.values(), kinds, strict=False) if kind == "U"]
            self.kind, parts = "continuous", f"{layout.n_parts} numbers"
            self.reason = parts if layout.n_parts > 1 else "a column of a continuous action"
            if layout.n_parts > 1 and (texts or layout.action_kind == "discrete"):
                own = (texts, "text"), ([part for part in layout.actions.values() if part not in texts], "numbers")
                said = ", ".join(f"{commas(names)} ({what})" for names, what in own if names)
                self.kind, self.reason = "refused", f"the action has several parts: {said}"
                self.fault = DataError(f"{steps.source}: {self.reason}; name the part to judge with --action.")
            return
        n, is_text, wanted = len(self.classes), layout.action.kind == "U", layout.action_kind
        try:
            self.kind, self.reason = action_kind(n, len(steps), is_text, self._is_whole, wanted, steps.source)
        except DataError as error:
            words = [one for one in self.classes.tolist() if is_text and not flat.is_number(one, ",")]
            said = f"{steps.source}: the action is text among numbers, as {quoted(words[:1])}; write numbers."
            fault = DataError(said) if 0 < 2 * len(words) < n else error
            self.kind, self.reason = "refused", fault.in_shell.removeprefix(f"{steps.source}: ").rstrip(".")
            self.fault = self.fault or fault
        if self.kind == "discrete":
            self.layout = replace(layout, action=self.classes.dtype)
        elif self.kind == "continuous":
            self.classes = np.empty(0)
            action = np.dtype(np.float32 if layout.action == np.float32 else np.float64)
            self.layout = replace(layout, action=action, n_parts=1)

    def summary(self) -> tuple[dict[str, tuple[float, float]], list[str], dict[str, int]]:
        """Smallest and largest of the numbers that are there; the observations that differ between demonstrations, and
        never within one; and how many values are missing by the column; without the columns that are left out."""
        left = [(column, k) for k, column in enumerate(self._read) if column not in self.left_out]
        names, low, high = {**self.layout.actions, **self.layout.observations}, self.low.tolist(), self.high.tolist()
        ranges = {names[column]: (low[k], high[k]) for column, k in left if low[k] == low[k]}
        constant = [names[m] for m, k in left if m in self.layout.observations and self.within[k] and low[k] < high[k]]
        return ranges, constant, {column: int(self.missing[k]) for column, k in left if self.missing[k]}


def scan(steps: Steps, layout: Layout, columns: Columns) -> Scan:
    """Read all steps once."""
    found, lengths = Scan(layout), np.diff(steps.offsets)
    if not columns.options.observations:
        of_lists = {part: name for name, parts in columns.lists.items() for part in parts}
        each = defaultdict[str, list[str]](list)  # the numbers of each column of the file
        for name in layout.observations:
            each[of_lists.get(name, name)].append(name)
        found.repeats = {(*own,) for own in each.values() if len(own) == max(layout.n_parts, 1)}
        if lengths.max(initial=1) > 2:  # any two numbers differ by a constant
            found.clocks = dict.fromkeys(layout.observations, inf)
    (bounds,) = shard_bounds(steps.offsets, 1, BLOCK_STEPS)
    for first, end in pairwise(bounds):
        rows = slice(int(steps.offsets[first]), int(steps.offsets[end]))
        owners = np.repeat(np.arange(first, end), lengths[first:end])
        found.add(steps.read(found._read, rows), owners, partial(steps.place_of, rows.start))
    found.finish(steps)
    return found


SHORT_NAMES = 6  # in one line


@dataclass(frozen=True)
class Description:
    """Description of a recording: demonstrations, steps, and the part that each column plays.

    Attributes
    ----------
    format : str
        Format and version of the file, as "LeRobot v3.0" or "CSV, separated by ;".
    seconds, fps : float, optional
        Duration of all demonstrations, and steps a second.
    action_kind, action_reason : str
        "discrete" or "continuous", and why.
    order_column, order : str
        The column that orders the steps of a demonstration, if any, and what was done about the order, in words.
    operators, tasks : tuple of str
        Their names, the first ones.
    ignored : mapping of str to str
        Columns that are not read, and why.
    missing : mapping of str to int
        Values that are missing, by column.
    ranges : mapping of str to pair of float
        Smallest and largest value of each observation and continuous action.
    notes : tuple of str
        What else a user should know, in sentences.
    """

    source: str
    format: str
    demonstrations: int
    steps: int
    observations: tuple[str, ...]
    actions: tuple[str, ...]
    action_kind: str
    action_reason: str
    id_column: str
    order_column: str | None = None
    order: str = "steps in the order of the file"
    seconds: float | None = None
    fps: float | None = None
    operator_column: str | None = None
    operators: tuple[str, ...] = ()
    task_column: str | None = None
    tasks: tuple[str, ...] = ()
    ignored: Mapping[str, str] = field(default_factory=dict)
    missing: Mapping[str, int] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, object]:
        """All of it, for JSON."""
        return asdict(self)

    def short(self) -> list[str]:
        """A few lines for the head of an audit."""
        lines = [self._size(), self._actions()]
        lines += [f"Observations: {len(self.observations):,}: {commas(self.observations)}."]
        lines += [f"Demonstrations by {self.id_column}; {self.order}."]
        missing = [f"{n:,} in {name}" for name, n in self.missing.items()]
        ignored = [f"{name or 'no name'} ({reason})" for name, reason in self.ignored.items()]
        parts = ("Missing values", missing), ("Ignored", ignored)
        return [*lines, *(f"{what}: {commas(own)}." for what, own in parts if own), *self.notes]

    def lines(self) -> list[str]:
        """Everything, for ``rpil info``; a column a line."""
        lines = [self._size(), f"Demonstrations by {self.id_column}; {self.order}.", self._actions()]
        given = ("Task", self.task_column, self.tasks), ("Operator", self.operator_column, self.operators)
        for what, column, names in given:
            if column:  # a task is often a sentence, with its full stop
                lines.append(f"{what}, in {column}: {commas([name.removesuffix('.') for name in names])}.")
        lines += [*self.notes, "", f"Observations: {len(self.observations):,}"]
        lines += [f"  {name}{self._range(name)}" for name in self.observations]
        if self.action_kind != "discrete":
            lines += ["Actions:", *(f"  {name}{self._range(name)}" for name in self.actions)]
        for title, values in (("Ignored", self.ignored), ("Missing values", self.missing)):
            if values:
                lines += [f"{title}:", *(f"  {name or 'no name'}: {value}" for name, value in values.items())]
        return lines

    def _size(self) -> str:
        numbers = f"{counted(self.demonstrations, 'demonstration')}, {counted(self.steps, 'step')}"
        size = f"{self.source}: {self.format}; {numbers}"
        if self.seconds is not None:
            size += f", {self.seconds:,.1f} s"
        return f"{size} at {self.fps:.4g} a second." if self.fps else f"{size}."

    def _actions(self) -> str:
        return f"Action: {commas(self.actions)}; {self.action_kind}: {self.action_reason}."

    def _range(self, name: str) -> str:
        return f": {self.ranges[name][0]:.6g} to {self.ranges[name][1]:.6g}" if name in self.ranges else ""


def commas(names: Iterable[object], most: int = SHORT_NAMES) -> str:
    """Up to `most` of the names in one line, with commas between them, and how many more there are."""
    return listed(names, most, last=", ")


Found = TypeVar("Found")

_MOST_NAMED = 30  # in one line


def without_damaged(
    names: Iterable[str], read: Callable[[str], Found], skips: object = True
) -> tuple[dict[str, Found], list[str]]:
    """Result of `read` for each file, and the names of damaged ones; an error if not `skips`, or if all are damaged."""
    found: dict[str, Found] = {}
    damaged: dict[str, DataError] = {}
    for name in names:
        try:
            found[name] = read(name)
        except DamagedError as error:
            damaged[name] = error
            if not skips:
                raise
    if damaged and not found:
        raise next(iter(damaged.values()))
    return found, [*damaged]


def parts_in_words(numbers: Iterable[int], what: str, names: Sequence[str]) -> str:
    """Numbers of lines or episodes of files, as "lines 2-7 and 9 of a.csv"; the files alone where there are none."""
    runs = [[m for _, m in run] for _, run in groupby(enumerate(sorted(numbers)), lambda one: one[1] - one[0])]
    words = commas([f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs], _MOST_NAMED)
    what = f"{what}s" if sum(map(len, runs)) > 1 else what
    return " of ".join([*([f"{what} {words}"] if runs else []), *([commas(names, _MOST_NAMED)] if names else [])])


def left_out_lines(skipped: Sequence[str], ids: Sequence[object] = ()) -> tuple[str, ...]:
    """Lines that name damaged parts, and demonstrations that were set aside; none where there are none."""
    damaged = [f"Skipped, because damaged: {', '.join(skipped)}."] if skipped else []
    named = commas(list(map(str, ids)), _MOST_NAMED)
    return (*damaged, *([f"Set aside: {named}, because a value is missing or infinite."] if ids else []))
