"""Base of every rule, and what rules that compare demonstrations know of them.

A rule is a class, found by its name in `rpil.faults.report.RULES`. It has words, what must be there for it, what it
measures of each demonstration, and how it compares what was measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from rpil.data.arrays import Id
from rpil.data.demonstrations import Demonstrations
from rpil.data.text import counted, duration, listed, moment, one_line, printable
from rpil.faults import settings
from rpil.faults.measured_columns import MeasuredColumns, MovingBlock, column_labels, learn_columns, pilot
from rpil.faults.tracking import Pair, Tracked, are_strangers, find_lag, find_tracked
from rpil.formats.format import Dataset
from rpil.numerics.types import Array, Int


@dataclass(frozen=True)
class Fault:
    """A fault of one demonstration, the worst of its kind there.

    Attributes
    ----------
    rule : str
        One of `rpil.faults.report.RULES`.
    id : int or str
        The demonstration.
    first, last : int
        Its steps concerned, from 0, both included.
    column : str
        The observation or action, or "" where the demonstration as a whole is concerned.
    value, threshold : float
        What was measured, and from where on it is a fault, both in the unit that the sentence names.
    severity : float
        How many times beyond the threshold; findings are sorted by it.
    sentence : str
        The finding in words, without the id of the demonstration.
    ids : tuple of ids
        The demonstrations concerned, where it is about several, and `id` is "".
    """

    rule: str
    id: Id
    first: int
    last: int
    column: str
    value: float
    threshold: float
    severity: float
    sentence: str
    ids: tuple[Id, ...] = ()

    @property
    def grade(self) -> str:
        """One of `GRADES`, of its rule."""
        return Rule.named[self.rule].grade

    @property
    def order(self) -> tuple[int, float]:
        """The worst kind first, and in it the most severe."""
        return GRADES.index(self.grade), -self.severity

    def to_dict(self) -> dict[str, object]:
        """As plain numbers and text; an infinite severity as None."""
        severity = self.severity if math.isfinite(self.severity) else None
        return {"grade": self.grade} | asdict(self) | {"severity": severity, "ids": [*self.ids]}


Grouping = Mapping[str, Mapping[str, str]]
"""The task, and the operator, of each demonstration, by its id as text."""

ALSO = "; the same in "  # begins what a sentence on one column says of others
MAX_NAMED = 60  # demonstrations, in a finding about several


def in_words(names: Sequence[Id], every: Sequence[Id], groups: Grouping) -> str:
    """How many of the demonstrations these are, and which: those of a task or an operator, the last ones, or by ids."""
    n, place = len(names), {name: m for m, name in enumerate(every)}
    if n == len(every):
        return f"all of {counted(n, 'demonstration')}"
    rows = [place[name] for name in names]
    said, rest = f"{n:,} of {len(every):,} demonstrations", {*every} - {*names}
    for kind, of in groups.items():
        those, others = ({of.get(str(name), "") for name in part} for part in (names, rest))
        if not those & others and len(those) == 1:
            return f"{said}, those of the {kind} {printable(min(those))!r}"
    if rows[-1] - rows[0] == n - 1 and n > 1:
        shown = f"from {names[0]} on" if rows[-1] == len(every) - 1 else f"{names[0]} to {names[-1]}"
        return f"{said}, {one_line(shown)}"
    return f"{said} ({listed(names, MAX_NAMED, ', ')})"


@dataclass(frozen=True, eq=False)
class Learned:
    """Facts about the set, learned from a sample of its demonstrations."""

    columns: MeasuredColumns
    pairs: tuple[Pair, ...]
    tracked: Tracked
    action_labels: tuple[str, ...]
    same: dict[int, str]  # observations that stay the same in the sample, and their labels
    are_strangers: bool  # see `rpil.faults.tracking.are_strangers`

    @classmethod
    def of(cls, demonstrations: Demonstrations | Dataset) -> Learned:
        """From demonstrations spread evenly over the data."""
        block, numbers = pilot(demonstrations)
        labels = column_labels(demonstrations)
        sample = learn_columns(block, numbers, labels)
        tracked = find_tracked(sample)
        told = [*tracked.action.tolist(), *tracked.state.tolist()] if tracked.is_command else []
        pairs, partner = find_lag(sample, settings.MAX_LAG, told)
        if tracked.is_command:
            partner[tracked.action], partner[tracked.state] = tracked.state, tracked.action
        states = block.observations[:, : settings.MOST_COLUMNS]
        same = {k: labels[k] for k in np.flatnonzero(states.min(axis=0) == states.max(axis=0)).tolist()}
        labels = labels[demonstrations.n_observations :]
        return cls(replace(sample.columns, partner=partner), pairs, tracked, labels, same, are_strangers(sample))


GRADES = "broken", "suspect", "odd"
"""A trainer stops, or trains on nonsense; a recorder or a robot failed, perhaps; it is unlike the others."""

Measure = Callable[[MovingBlock, Learned], tuple[Array, ...]]
"""Gives arrays (M, ...) of the M demonstrations of a block."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """The values that rules compare: what each `Measure` gave for all M demonstrations without missing values."""

    learned: Learned
    measured: Mapping[Measure, tuple[Array, ...]]
    ids: tuple[Id, ...]
    lengths: Int[Array, " M"]
    seconds: float | None  # between two frames, if that is known
    groups: Grouping = field(default_factory=dict)

    @cached_property
    def lacking(self) -> dict[str, str]:
        """Reasons why something that rules may need is not there."""
        columns, least = self.learned.columns, settings.FEWEST_DEMONSTRATIONS
        codes = "every {} is constant, a code or a pixel, and measures nothing"
        reasons = {
            "observations": (columns.is_action.all(), codes.format("observation")),
            "actions": (not columns.is_action.any(), codes.format("action")),
            "columns": (not columns.names, codes.format("observation or action")),
            "commands": (not len(self.learned.tracked.action), "no action is the command of a state"),
            "lag": (not self.learned.pairs and not self.learned.tracked.is_command, "no observation follows an action"),
            "several": (len(self.ids) < least, f"it takes {least} demonstrations to know what is usual"),
        }
        return {need: reason for need, (is_lacking, reason) in reasons.items() if is_lacking}

    def of_each(self, kind: str) -> list[str]:
        """The task, or the operator, of each demonstration; "" where it is not known."""
        return [self.groups.get(kind, {}).get(str(name), "") for name in self.ids]

    def in_steps(self, steps: int) -> str:
        """Steps in words, with their time where it is known."""
        time = "" if self.seconds is None else f" ({1e3 * self.seconds * steps:.0f} ms)"
        return f"{counted(steps, 'step')}{time}"


class Rule:
    """A rule without a model; see docs/faults.md."""

    name: str
    words: str  # what it finds
    grade: str = "suspect"  # one of `GRADES`
    needs: tuple[str, ...] = ()  # what must be there, keys of `Measurements.lacking`
    unknown = "demonstrations move too little, or differ too much in this, to know what is usual"
    """Why it says nothing where it applies and nothing can be known."""
    causes: tuple[str, ...] = ()  # rules whose findings explain those of this rule in the same demonstration
    named: ClassVar[dict[str, type[Rule]]] = {}  # every rule that has a name

    def __init_subclass__(cls) -> None:
        if "name" in vars(cls):
            Rule.named[cls.name] = cls

    @classmethod
    def follows(cls, fault: Fault, cause: Fault) -> bool:
        """Whether a finding of this rule follows from another one, of a rule of `causes`, in the same demonstration.

        A demonstration that is too long may hold what is found; one that is too short explains nothing."""
        return cause.rule != "length" or cause.value > cause.threshold


Compared = tuple[Array, Array | float, Array]
"""The measured value, from where on it is a fault, and how many times beyond that it is; (M,) or (M, C)."""


class ComparingRule(Rule):
    """A rule that compares each demonstration with the others, applied to M of them.

    `names` are those of C columns, or one, "", for the demonstration as a whole. `value`, `threshold`, `severity`, and
    the `first` and `last` steps concerned, are (M, C). Where nothing can be known about a column, because it differs
    too much between demonstrations that are clean or because it does not move, its severity is NaN.
    """

    needs: tuple[str, ...] = ("columns", "several")
    sentence: str
    sentence_of_all: str = ""
    """Sentences for one column and for all together, which may name the fields of `Fault`, and what `say` adds."""
    takes_steps = False  # whether it says nothing of demonstrations of fewer than `LEAST_STEPS`

    def __init__(self, data: Measurements) -> None:
        self.data, self.columns = data, data.learned.columns
        self.names: tuple[str, ...] = ("",)
        self.measured = data.measured[type(self).measure]
        self.first, self.last = np.zeros(len(data.ids), dtype=int), data.lengths - 1
        value, threshold, severity = self.compare()
        is_short = self.takes_steps & (data.lengths < settings.LEAST_STEPS)
        severity = np.where(is_short, np.nan, np.transpose(severity)).T
        shape = len(data.ids), len(self.names)
        every = value, np.broadcast_to(threshold, np.shape(value)), severity, self.first, self.last
        self.value, self.threshold, self.severity, self.first, self.last = (
            np.broadcast_to(np.reshape(of_each, (shape[0], -1)), shape) for of_each in every
        )

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """The measure that the rule needs of each demonstration. Steps count from the first of the demonstration, 0."""
        return ()

    def compare(self) -> Compared:
        """Compare what was measured of all demonstrations; here without a fault."""
        nothing = np.zeros(len(self.data.ids))
        return nothing, 1.0, nothing

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        """A sentence on a demonstration and a column. It may name `others`, and as times where they are
        known, or else as steps: `first`, `last`, `long` from one to the other, and `most`, the threshold."""
        seconds, length = self.data.seconds, fault.last - fault.first + 1
        times = {"first": moment(fault.first, seconds), "last": moment(fault.last, seconds)}
        times |= {"long": duration(length, seconds), "most": duration(fault.threshold, seconds)}
        sentence = self.sentence if fault.column else self.sentence_of_all or self.sentence
        return sentence.format(**vars(fault) | times | others)

    @property
    def silent(self) -> tuple[str, ...]:
        """The columns about which nothing can be known."""
        is_unknown: Array = np.isnan(self.severity)
        return tuple(name for name, column in zip(self.names, is_unknown.T, strict=True) if column.all())

    def findings(self) -> Iterator[Fault]:
        """For each demonstration with a fault, its worst column."""
        severity = np.nan_to_num(self.severity, nan=0.0)
        for m in np.flatnonzero((severity > 1.0).any(axis=1)).tolist():
            c = int(np.argmax(severity[m]))
            more = sum(bool(name) for k, name in enumerate(self.names) if k != c and severity[m, k] > 1.0)
            also = f"{ALSO}{counted(more, 'more column')}" if more else ""
            value, threshold, worst = (float(of_each[m, c]) for of_each in (self.value, self.threshold, severity))
            place = self.data.ids[m], int(self.first[m, c]), int(self.last[m, c]), self.names[c]
            fault = Fault(self.name, *place, value, threshold, worst, sentence="")
            yield replace(fault, sentence=self.say(fault, m, c) + also)

    def with_all(self, of_columns: Compared, of_all: Compared, first: Array, last: Array) -> Compared:
        """The compared columns, and beside them, as one without a name, of all of them together."""
        self.names = (*self.names, "")
        self.first, self.last = (np.column_stack(each) for each in ((self.first, first), (self.last, last)))
        every = zip(np.broadcast_arrays(*of_columns), np.broadcast_arrays(*of_all), strict=True)
        value, threshold, severity = (np.column_stack(each) for each in every)
        return value, threshold, severity

    def fence(self, values: Array, factor: float, least: Array | float) -> Array:
        """Where values (M, ...) of demonstrations begin to be unusual; infinite where they differ too much to tell.

        With quartiles q1 and q3 over the demonstrations, and s = `least`, the size below which values do not differ:

            (q3 + s) max(factor, r),    r = ((q3 + s) / (q1 + s))^fence,    for r up to `LARGEST_SPREAD`.
        """
        low, high = np.quantile(values, [0.25, 0.75], axis=0, method="lower") + least
        spread = (high / np.maximum(low, 1e-300)) ** settings.FENCE
        return np.asarray(np.where(spread <= settings.LARGEST_SPREAD, high * np.maximum(factor, spread), np.inf))

    def two_fences(self, values: Array, factor: float) -> tuple[Array, Array]:
        """Where positive values (M, ...) begin to be unusually small, and unusually large."""
        return 1.0 / self.fence(1.0 / values, factor, 0.0), self.fence(values, factor, 0.0)


def above(value: Array, threshold: Array | float) -> Compared:
    """Values above their thresholds are faults; an infinite or missing threshold says that nothing is known."""
    beyond = value / np.where(np.asarray(threshold) > 0, threshold, 1.0)
    return value, threshold, np.where(np.isfinite(threshold), beyond, np.nan)
