"""The rules that compare each demonstration with the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from rpil.audit.faults.columns import Columns
from rpil.audit.faults.measure import Measured
from rpil.audit.faults.record import Finding
from rpil.audit.faults.settings import FaultSettings
from rpil.data.arrays import Id
from rpil.numerics.types import Array


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the rules compare."""

    measured: Measured
    columns: Columns
    ids: tuple[Id, ...]
    lengths: Array
    settings: FaultSettings

    def find(self, rule: str, worst: Worst, steps: Steps, say: Callable[[int, int], str]) -> Iterator[Finding]:
        """A finding for each demonstration beyond its threshold; `say` and `steps` get the demonstration and column."""
        for m in np.flatnonzero(worst.severity > 1.0).tolist():
            c = int(worst.column[m])
            first, last = steps(m, c)
            more = int(worst.n_columns[m]) - 1
            yield Finding(
                rule,
                self.ids[m],
                first,
                last,
                self.columns.names[c] if worst.by_column else "",
                float(worst.value[m]),
                float(worst.threshold[m]),
                float(worst.severity[m]),
                say(m, c) + (f", and {more} more columns" if more > 1 else ", and 1 more column" if more else ""),
            )


Steps = Callable[[int, int], tuple[int, int]]


@dataclass(frozen=True, eq=False)
class Worst:
    """Of each demonstration the column that is furthest beyond its threshold, (M,) each."""

    column: Array
    value: Array
    threshold: Array
    severity: Array
    n_columns: Array
    by_column: bool = True

    @classmethod
    def of(cls, value: Array, threshold: Array, severity: Array | None = None) -> Worst:
        """From (M, C) or (M,) values, and their thresholds."""
        by_column = value.ndim == 2
        value, threshold = (np.reshape(a, (len(value), -1)) for a in (value, np.broadcast_to(threshold, value.shape)))
        ratio = np.divide(value, threshold) if severity is None else severity.reshape(value.shape)
        column = np.argmax(ratio, axis=1) if ratio.shape[1] else np.zeros(len(value), dtype=int)
        at = np.arange(len(value)), column
        return cls(column, value[at], threshold[at], ratio[at], (ratio > 1).sum(axis=1), by_column)


def fence(values: Array, factor: float, least: Array | float, settings: FaultSettings) -> Array:
    """Where values (M, ...) of demonstrations begin to be unusual.

    With quartiles q1 and q3 over the demonstrations, and s = `least`, the size below which values do not differ:

        (q3 + s) max(factor, ((q3 + s) / (q1 + s))^fence)
    """
    low, high = np.quantile(values, [0.25, 0.75], axis=0, method="lower") + least
    return np.asarray(high * np.maximum(factor, (high / low) ** settings.fence))


def find_spikes(seen: Evidence) -> Iterator[Finding]:
    """Single values far from both neighbours."""
    by, s = seen.measured, seen.settings
    worst = Worst.of(by.spike, fence(by.spike, s.spike_factor, s.smallest * seen.columns.scale, s))
    return seen.find(
        "spike",
        worst,
        lambda m, c: (int(by.spike_step[m, c]),) * 2,
        lambda m, c: (
            f"{seen.columns.names[c]} is {by.spike[m, c]:.3g} away from its neighbours at step {by.spike_step[m, c]} "
            f"(at most {worst.threshold[m]:.3g} is usual)"
        ),
    )


def find_jumps(seen: Evidence) -> Iterator[Finding]:
    """Leaps that are not taken back at the next step."""
    by, s = seen.measured, seen.settings
    worst = Worst.of(by.jump, fence(by.jump, s.jump_factor, s.smallest * seen.columns.scale, s))
    return seen.find(
        "jump",
        worst,
        lambda m, c: (int(by.jump_step[m, c]) - 1, int(by.jump_step[m, c])),
        lambda m, c: (
            f"{seen.columns.names[c]} leaps by {by.jump[m, c]:.3g} at step {by.jump_step[m, c]} "
            f"(at most {worst.threshold[m]:.3g} is usual)"
        ),
    )


def find_constant_runs(seen: Evidence) -> Iterator[Finding]:
    """Frozen sensors, frozen actions and saturation: one value for long, while others move."""
    by, s, columns = seen.measured, seen.settings, seen.columns
    threshold = np.maximum(fence(by.still, s.frozen_factor, 2.0, s), s.min_frozen)
    at_limit = (by.run_value == by.low.min(axis=0)) | (by.run_value == by.high.max(axis=0))
    for rule, own in (
        ("saturation", at_limit),
        ("frozen sensor", ~at_limit & ~columns.is_action),
        ("frozen action", ~at_limit & columns.is_action),
    ):
        worst = Worst.of(np.where(own, by.still, 0), threshold)
        yield from seen.find(
            rule,
            worst,
            lambda m, c: (int(by.run_step[m, c]), int(by.run_step[m, c] + by.run[m, c]) - 1),
            lambda m, c, worst=worst: (  # type: ignore[misc]
                f"{columns.names[c]} is {by.run_value[m, c]:.4g} for {by.run[m, c]} steps from step "
                f"{by.run_step[m, c]} (at most {worst.threshold[m]:.0f} are usual) while others change"
            ),
        )


def find_repeated_rows(seen: Evidence) -> Iterator[Finding]:
    """Rows that repeat the one before while everything moves."""
    by, s = seen.measured, seen.settings
    worst = Worst.of(by.repeats, fence(by.repeats, s.repeat_factor, 0.1, s))
    return seen.find(
        "repeated frames",
        worst,
        lambda m, _: (int(by.repeat_step[m]), int(by.repeat_step[m] + by.repeat_run[m]) - 1),
        lambda m, _: (
            f"{by.repeats[m]} rows repeat the row before while all moves, the longest repetition at step "
            f"{by.repeat_step[m]}"
        ),
    )


def find_idle_ends(seen: Evidence) -> Iterator[Finding]:
    """Idle beginnings and ends, which may be trimmed."""
    by, s = seen.measured, seen.settings
    for rule, idle in (("idle head", by.head), ("idle tail", by.tail)):
        worst = Worst.of(idle, np.maximum(fence(idle, s.idle_factor, 1.0, s), s.min_idle))
        is_head = rule == "idle head"
        yield from seen.find(
            rule,
            worst,
            lambda m, _, is_head=is_head: (  # type: ignore[misc]
                (0, int(by.head[m]) - 1) if is_head else (int(seen.lengths[m] - by.tail[m]), int(seen.lengths[m]) - 1)
            ),
            lambda m, _, idle=idle, worst=worst, end="first" if is_head else "last": (  # type: ignore[misc]
                f"nothing moves in the {end} {idle[m]} steps (at most {worst.threshold[m]:.0f} are usual)"
            ),
        )


def find_lengths(seen: Evidence) -> Iterator[Finding]:
    """Demonstrations far longer or shorter than the others."""
    s, lengths = seen.settings, seen.lengths.astype(float)
    low, high = _two_fences(lengths, s.length_factor, s)
    severity = np.maximum(lengths / high, low / lengths)
    worst = Worst.of(lengths, np.where(lengths > high, high, low), severity)
    return seen.find(
        "length",
        worst,
        lambda m, _: (0, int(lengths[m]) - 1),
        lambda m, _: f"it has {lengths[m]:.0f} steps ({low:.0f} to {high:.0f} are usual)",
    )


def find_scales(seen: Evidence) -> Iterator[Finding]:
    """Columns whose values and changes are both many times larger, or smaller, than elsewhere."""
    by, s, least = seen.measured, seen.settings, 1e-3 * seen.columns.spread
    levels, changes = by.level + least, by.change + 1e-3 * seen.columns.scale
    (low, high), (slow, fast) = (_two_fences(values, s.scale_factor, s) for values in (levels, changes))
    larger, smaller = np.minimum(levels / high, changes / fast), np.minimum(low / levels, slow / changes)
    usual = np.median(levels, axis=0)
    worst = Worst.of(levels / usual, np.where(larger > smaller, high, low) / usual, np.maximum(larger, smaller))
    return seen.find(
        "scale",
        worst,
        lambda m, _: (0, int(seen.lengths[m]) - 1),
        lambda m, c: (
            f"{seen.columns.names[c]} is {worst.value[m]:.3g} times its usual size, and so are its changes: "
            "perhaps another unit"
        ),
    )


def _two_fences(values: Array, factor: float, settings: FaultSettings) -> tuple[Array, Array]:
    """Where positive values (M, ...) begin to be unusually small, and unusually large."""
    return 1.0 / fence(1.0 / values, factor, 0.0, settings), fence(values, factor, 0.0, settings)


def find_lags(seen: Evidence) -> Iterator[Finding]:
    """Demonstrations whose state follows the action sooner or later than elsewhere."""
    by, s = seen.measured, seen.settings
    is_odd = np.abs(by.shift) >= s.min_shift
    worst = Worst.of(np.abs(by.shift), np.full(len(by.shift), s.min_shift), is_odd * by.shift_gain / s.shift_gain)
    return seen.find(
        "lag",
        worst,
        lambda m, _: (0, int(seen.lengths[m]) - 1),
        lambda m, _: f"the state follows the action {abs(by.shift[m])} steps {_later(by.shift[m])} than is usual",
    )


def _later(shift: int) -> str:
    return "later" if shift > 0 else "sooner"


COMPARISONS: dict[tuple[str, ...], Callable[[Evidence], Iterator[Finding]]] = {
    ("spike",): find_spikes,
    ("jump",): find_jumps,
    ("frozen sensor", "frozen action", "saturation"): find_constant_runs,
    ("repeated frames",): find_repeated_rows,
    ("idle head", "idle tail"): find_idle_ends,
    ("scale",): find_scales,
    ("lag",): find_lags,
    ("length",): find_lengths,
}
"""The rules that compare demonstrations, and what they find."""
