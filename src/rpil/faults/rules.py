"""The rules that compare each demonstration with the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from rpil.data.arrays import Id
from rpil.data.text import counted
from rpil.faults.measure import Learned, Measured
from rpil.faults.measured_columns import MeasuredColumns
from rpil.faults.report import Fault
from rpil.faults.settings import FaultSettings
from rpil.numerics.types import Array, Float


@dataclass(frozen=True, eq=False)
class Measurements:
    """What the rules compare."""

    measured: Measured
    columns: MeasuredColumns
    learned: Learned
    ids: tuple[Id, ...]
    lengths: Array
    seconds: float | None  # between two frames, if that is known
    settings: FaultSettings

    def whole(self, m: int, _: int) -> tuple[int, int]:
        """The first and the last step of a demonstration."""
        return 0, int(self.lengths[m]) - 1

    def duration(self, steps: int) -> str:
        """Steps in words, with their time where it is known."""
        time = "" if self.seconds is None else f" ({1e3 * self.seconds * steps:.0f} ms)"
        return f"{counted(steps, 'step')}{time}"


@dataclass(frozen=True, eq=False)
class AppliedRule:
    """A rule applied to M demonstrations and the columns `names`, which are one, "", for the demonstration as a whole.

    Where nothing can be known about a column, because it differs too much between demonstrations that are clean or
    because it does not move, its severity is NaN.
    """

    rule: str
    names: tuple[str, ...]
    value: Float[Array, "M C"]
    threshold: Float[Array, "M C"]
    severity: Float[Array, "M C"]
    steps: Callable[[int, int], tuple[int, int]]  # of a demonstration and a column
    say: Callable[[int, int], str]

    @classmethod
    def above(
        cls,
        rule: str,
        names: tuple[str, ...],
        value: Array,
        threshold: Array,
        steps: Callable[[int, int], tuple[int, int]],
        say: Callable[[int, int], str],
    ) -> AppliedRule:
        """Values above their thresholds are faults; an infinite or missing threshold says that nothing is known."""
        value = np.reshape(value, (len(value), -1)).astype(float)
        threshold = np.broadcast_to(threshold, value.shape)
        severity = np.where(np.isfinite(threshold), value / np.where(threshold > 0, threshold, 1.0), np.nan)
        return cls(rule, names, value, threshold, severity, steps, say)

    @property
    def unknown(self) -> tuple[str, ...]:
        """The columns about which nothing can be known."""
        is_unknown: Array = np.isnan(self.severity)
        return tuple(name for name, column in zip(self.names, is_unknown.T, strict=True) if column.all())

    def findings(self, ids: tuple[Id, ...]) -> Iterator[Fault]:
        """For each demonstration with a fault, its worst column."""
        severity = np.nan_to_num(self.severity, nan=0.0)
        for m in np.flatnonzero((severity > 1.0).any(axis=1)).tolist():
            c = int(np.argmax(severity[m]))
            more = int((severity[m] > 1.0).sum()) - 1
            also = f", and {counted(more, 'more column')}" if more else ""
            value, threshold = float(self.value[m, c]), float(self.threshold[m, c])
            at = self.steps(m, c)
            yield Fault(
                self.rule, ids[m], *at, self.names[c], value, threshold, float(severity[m, c]), self.say(m, c) + also
            )


def fence(values: Array, factor: float, least: Array | float, settings: FaultSettings) -> Array:
    """Where values (M, ...) of demonstrations begin to be unusual; infinite where they differ too much to tell.

    With quartiles q1 and q3 over the demonstrations, and s = `least`, the size below which values do not differ:

        (q3 + s) max(factor, r),    r = ((q3 + s) / (q1 + s))^fence,    for r up to `max_spread`.
    """
    low, high = np.quantile(values, [0.25, 0.75], axis=0, method="lower") + least
    spread = (high / np.maximum(low, 1e-300)) ** settings.fence
    return np.asarray(np.where(spread <= settings.max_spread, high * np.maximum(factor, spread), np.inf))


def two_fences(values: Array, factor: float, settings: FaultSettings) -> tuple[Array, Array]:
    """Where positive values (M, ...) begin to be unusually small, and unusually large."""
    return 1.0 / fence(1.0 / values, factor, 0.0, settings), fence(values, factor, 0.0, settings)


def compare_leaps(seen: Measurements) -> Iterator[AppliedRule]:
    """Spikes and jumps: larger than usual, than the usual largest change, and than a share of the column's spread."""
    by, s, columns = seen.measured, seen.settings, seen.columns
    usual = s.change_factor * np.quantile(by.largest, 0.75, axis=0, method="lower")
    least = np.maximum(usual, s.smallest_leap * columns.spread)

    def describe_spike(m: int, c: int) -> str:
        at = f"{columns.names[c]} is {by.spike[m, c]:.3g} away from its neighbours at step {by.spike_step[m, c]}"
        return f"{at} ({spikes[c]:.3g} at most is usual)"

    def describe_jump(m: int, c: int) -> str:
        leap = f"{columns.names[c]} leaps by {by.jump[m, c]:.3g} at step {by.jump_step[m, c]}"
        return f"{leap} ({jumps[c]:.3g} at most is usual)"

    limits = (np.maximum(fence(value, s.leap_factor, s.smallest * least, s), least) for value in (by.spike, by.jump))
    spikes, jumps = (np.where(columns.moving < s.least_moving, np.inf, limit) for limit in limits)
    yield AppliedRule.above(
        "spike", columns.names, by.spike, spikes, lambda m, c: (int(by.spike_step[m, c]),) * 2, describe_spike
    )
    yield AppliedRule.above(
        "jump",
        columns.names,
        by.jump,
        jumps,
        lambda m, c: (int(by.jump_step[m, c]) - 1, int(by.jump_step[m, c])),
        describe_jump,
    )


def compare_constant_runs(seen: Measurements) -> Iterator[AppliedRule]:
    """Frozen sensors, frozen actions and saturation: one value for long, while others move."""
    by, s, columns = seen.measured, seen.settings, seen.columns
    limits = np.maximum(fence(by.still, s.frozen_factor, s.smallest_run, s), s.min_frozen)
    limits = np.where(columns.moving >= s.min_moving, limits, np.inf)
    bottom, top = by.low.min(axis=0), by.high.max(axis=0)
    near = 0.01 * (top - bottom)
    at_bottom, at_top = by.run_value <= bottom + near, by.run_value >= top - near
    # Where many demonstrations reach a limit it is the robot's own.
    usual_bottom = (by.low <= bottom + near).mean(axis=0) >= s.common_limit
    usual_top = (by.high >= top - near).mean(axis=0) >= s.common_limit
    at_limit = (at_bottom & usual_bottom) | (at_top & usual_top)
    at_limit |= by.run_step == 0  # what has not been touched yet rests
    is_extreme = (by.run_value == bottom) | (by.run_value == top)
    for rule, own, is_fault in (
        ("saturation", np.arange(len(columns.names)), is_extreme & ~at_limit),
        ("frozen sensor", np.flatnonzero(~columns.is_action), ~is_extreme & ~at_limit),
        ("frozen action", np.flatnonzero(columns.is_action), ~is_extreme & ~at_limit),
    ):

        def steps(m: int, k: int, own: Array = own) -> tuple[int, int]:
            first = int(by.run_step[m, own[k]])
            return first, first + int(by.run[m, own[k]]) - 1

        def say(m: int, k: int, own: Array = own) -> str:
            c = own[k]
            stays = f"{columns.names[c]} stays at {by.run_value[m, c]:.4g} for {by.run[m, c]} steps"
            return f"{stays} from step {by.run_step[m, c]} while others move ({limits[c]:.0f} at most are usual)"

        names = tuple(columns.names[c] for c in own)
        yield AppliedRule.above(rule, names, np.where(is_fault, by.still, 0)[:, own], limits[own], steps, say)


def compare_repeated_rows(seen: Measurements) -> Iterator[AppliedRule]:
    """Rows that repeat the one before while everything moves."""
    by, s = seen.measured, seen.settings
    limit = fence(by.repeats, s.usual_factor, s.smallest_repeat, s)
    yield AppliedRule.above(
        "repeated frames",
        ("",),
        by.repeats,
        limit,
        lambda m, _: (int(by.repeat_step[m]), int(by.repeat_step[m] + by.repeat_run[m]) - 1),
        lambda m, _: (
            f"{by.repeats[m]} rows repeat the row before while all moves, the longest from step "
            f"{by.repeat_step[m]} ({limit:.0f} at most are usual)"
        ),
    )


def compare_idle_ends(seen: Measurements) -> Iterator[AppliedRule]:
    """Idle beginnings and ends, which may be trimmed."""
    s, lengths = seen.settings, seen.lengths.astype(int)
    for rule, words, idle in (
        ("idle head", "first", seen.measured.head),
        ("idle tail", "last", seen.measured.tail),
    ):
        limit = max(float(fence(idle, s.usual_factor, s.min_idle / s.usual_factor, s)), s.min_idle)

        def steps(m: int, _: int, idle: Array = idle, at_head: bool = words == "first") -> tuple[int, int]:
            return (0, int(idle[m]) - 1) if at_head else (int(lengths[m] - idle[m]), int(lengths[m]) - 1)

        def say(m: int, _: int, idle: Array = idle, words: str = words, limit: float = limit) -> str:
            return f"nothing moves in the {words} {idle[m]} steps ({limit:.0f} at most are usual)"

        yield AppliedRule.above(rule, ("",), idle, np.asarray(limit), steps, say)


def compare_lengths(seen: Measurements) -> Iterator[AppliedRule]:
    """Demonstrations far longer or shorter than the others."""
    lengths = seen.lengths.astype(float)[:, None]
    low, high = two_fences(lengths, seen.settings.length_factor, seen.settings)
    severity = np.maximum(lengths / high, low / lengths)
    severity[:, ~np.isfinite(high) | (low == 0)] = np.nan
    yield AppliedRule(
        "length",
        ("",),
        lengths,
        np.where(lengths > high, high, low),
        severity,
        seen.whole,
        lambda m, _: f"it has {lengths[m, 0]:.0f} steps ({low[0]:.0f} to {high[0]:.0f} are usual)",
    )


def compare_scales(seen: Measurements) -> Iterator[AppliedRule]:
    """MeasuredColumns whose values and changes are both many times larger, or smaller, than elsewhere.

    A quiet demonstration has small values in all its columns; a smaller column must be so beside the others as well.
    """
    by, s, columns = seen.measured, seen.settings, seen.columns
    if not columns.names:
        return
    levels, changes = by.level + 1e-3 * columns.spread, by.change + 1e-3 * columns.scale
    (low, high), (slow, fast) = (two_fences(values, s.scale_factor, s) for values in (levels, changes))
    ratio = levels / np.median(levels, axis=0)
    beside = np.median(ratio, axis=1, keepdims=True) / ratio / s.scale_factor
    larger = np.minimum(levels / high, changes / fast)
    smaller = np.minimum(np.minimum(low / levels, slow / changes), beside)
    severity = np.maximum(larger, smaller)
    severity[:, ~np.isfinite(high + fast) | (low * slow == 0) | (columns.moving < s.min_moving)] = np.nan

    def say(m: int, c: int) -> str:
        times = f"{ratio[m, c]:.3g} times" if ratio[m, c] >= 1 else f"1 / {1 / ratio[m, c]:.3g} of"
        return f"{columns.names[c]} has {times} its usual size, and so have its changes: perhaps another unit"

    limits = np.where(larger > smaller, high, low) / np.median(levels, axis=0)
    yield AppliedRule("scale", columns.names, ratio, limits, severity, seen.whole, say)


def compare_lags(seen: Measurements) -> Iterator[AppliedRule]:
    """Demonstrations whose state follows the action sooner or later than elsewhere."""
    by, s = seen.measured, seen.settings
    steps = np.abs(by.shift)
    least_gain = float(fence(by.shift_gain, s.usual_factor, s.smallest_gain, s))
    severity = np.where(steps >= s.min_shift, by.shift_gain / least_gain, 0.0)
    if not is_lag_known(seen):
        severity = np.full(len(steps), np.nan)

    def say(m: int, _: int) -> str:
        off = seen.duration(int(steps[m]))
        return f"the state follows the action {off} {'later' if by.shift[m] > 0 else 'sooner'} than is usual"

    limit = np.full((len(steps), 1), float(s.min_shift))
    whole = "lag", ("",), steps[:, None].astype(float), limit, severity[:, None]
    yield AppliedRule(*whole, seen.whole, say)


def is_lag_known(seen: Measurements) -> bool:
    """Whether most demonstrations have the same lag."""
    s, by = seen.settings, seen.measured
    agree = ((np.abs(by.shift) < s.min_shift) | (by.shift_gain < s.smallest_gain)).mean() >= s.min_agreement
    return bool(
        seen.learned.lag.pairs and agree and np.isfinite(fence(by.shift_gain, s.usual_factor, s.smallest_gain, s))
    )


COMPARISONS: tuple[Callable[[Measurements], Iterator[AppliedRule]], ...] = (
    compare_leaps,
    compare_constant_runs,
    compare_repeated_rows,
    compare_idle_ends,
    compare_lengths,
    compare_scales,
    compare_lags,
)
"""The rules that compare demonstrations."""
