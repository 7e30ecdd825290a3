"""The rules about whole demonstrations: whether undoing a fault mends them, and what they are made of."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.stats import mannwhitneyu

from rpil.faults.record import finds
from rpil.faults.rules import Comparison, Evidence
from rpil.faults.undo import SHIFTS, UNITS
from rpil.numerics.types import Array

TRIED = {
    "sign": ("sign",),
    "scale": ("scale",),
    "offset": ("offset",),
    "exchanged": ("exchanged",),
    "shifted action": ("+1", "-1"),
    "lag": SHIFTS[2:],
    "reversed": ("reversed",),
    "frame rate": ("frame rate",),
}
"""Rule to the faults that are tried."""


@finds("lag", "sign", "offset", "exchanged", "shifted action", "reversed", "frame rate")
def compare_maps(seen: Evidence) -> Iterator[Comparison]:
    """Demonstrations that fit the map between states and actions of the others once a fault is undone."""
    namer, by = seen.learned.namer, seen.measured
    if namer is None:
        return
    tried, whole = namer.tried, [(0, length - 1) for length in seen.lengths.astype(int).tolist()]
    names = np.array(seen.columns.names)[namer.frame.column]
    for rule, kinds in TRIED.items():
        own = np.flatnonzero(np.isin(tried.kind, kinds))
        if not len(own):
            continue
        called = tuple(" and ".join(names[c[c >= 0]]) for c in tried.columns[own])
        limit = np.where(np.isnan(namer.limit[own]), np.inf, namer.limit[own])
        value = np.where(by.named[:, None] == own, by.gain[:, :1], 0.0)

        def say(m: int, k: int, rule: str = rule, own: Array = own, called: tuple[str, ...] = called) -> str:
            h, off = own[k], by.gain[m, 1]
            by_factor = UNITS[k // len(names)] if rule == "scale" else 1.0
            spread = namer.frame.spread[tried.columns[h, 0]]
            steps = int(tried.kind[h]) if rule == "lag" else 0
            way = "sooner" if steps > 0 else "later"
            words = {
                "sign": f"{called[k]} has the other sign",
                "scale": f"{called[k]} has {1 / by_factor:.3g} times its usual size: perhaps another unit",
                "offset": f"{called[k]} is off by {-off * spread:.3g}, {abs(off):.2g} of its standard deviations",
                "exchanged": f"{called[k]} are exchanged",
                "shifted action": f"the actions are one step {'late' if tried.kind[h] == '+1' else 'early'}",
                "lag": f"the state follows the action {seen.duration(abs(steps))} {way} than is usual",
                "reversed": "time is reversed: it runs backwards",
                "frame rate": "it has half the frame rate of the others: every other step is missing",
            }
            return f"{words[rule]}; undone, it fits the others"

        severity = np.where(np.isfinite(limit), value / limit, np.nan)
        if rule == "lag":
            value = np.abs([int(kind) for kind in tried.kind[own]]) * np.ones_like(value)
        yield Comparison(rule, called, value, np.broadcast_to(limit, value.shape), severity, lambda m, _: whole[m], say)


@finds("two episodes")
def compare_boundaries(seen: Evidence) -> Iterator[Comparison]:
    """Demonstrations that hold an end and then a beginning."""
    ends, by = seen.learned.ends, seen.measured
    limit = np.nan if ends is None else ends.limit
    step = by.boundary[:, 1].astype(int)
    unlike, m = by.boundary[:, :1], len(by.boundary)
    severity = np.where(unlike < limit, 1.0 + (limit - unlike), 0.0) if np.isfinite(limit) else np.full((m, 1), np.nan)
    yield Comparison(
        "two episodes",
        ("",),
        unlike,
        np.full((m, 1), limit),
        np.minimum(severity, 100.0),
        lambda m, _: (int(step[m]) - 1, int(step[m])),
        lambda m, _: f"step {step[m]} is like a beginning, and the one before like an end: perhaps two episodes in one",
    )


@finds("next state")
def compare_next_states(seen: Evidence) -> Iterator[Comparison]:
    """Demonstrations whose actions are the next state, where those of others are not."""
    moves, same = seen.measured.next_state.sum(axis=1).T
    share = same / np.maximum(moves, 1.0)
    usual = float(np.median(share))
    limit = (1.0 + usual) / 2 if usual < 0.75 else np.inf  # some actions, of a hand, may be so always
    yield Comparison.above(
        "next state",
        ("",),
        share,
        np.asarray(limit),
        lambda m, _: (0, int(seen.lengths[m]) - 1),
        lambda m, _: f"{100 * share[m]:.0f} % of the actions that move are the state at the next step",
    )


@finds("never moves")
def compare_ranges(seen: Evidence) -> Iterator[Comparison]:
    """Columns, codes such as an open gripper included, that move in the others and never in this one."""
    by, s, columns = seen.measured, seen.settings, seen.columns
    names = tuple(columns.labels[k] for k in columns.numbered)
    usual = np.median(by.ranges, axis=0)
    still = by.ranges <= s.least_range * usual
    low = np.where(still, np.inf, by.ranges).min(axis=0)
    steady = np.isin(columns.numbered, columns.number[columns.moving >= s.min_moving])  # or as far each time
    is_known = (usual > 0) & (still.mean(axis=0) < 0.25) & (steady | (low >= s.steady_range * usual))
    least = np.where(is_known, 0.5, np.inf)
    yield Comparison.above(
        "never moves",
        names,
        still.astype(float),
        least,
        lambda m, _: (0, int(seen.lengths[m]) - 1),
        lambda m, c: f"{names[c]} never moves, and in the others it does",
    )


def session(seen: Evidence) -> str | None:
    """Whether the first quarter of the demonstrations differs from the last, in words: that is no fault."""
    quarter = len(seen.ids) // 4
    level = seen.measured.level
    if quarter < 3 or not level.shape[1]:
        return None
    chance = mannwhitneyu(level[:quarter], level[-quarter:], axis=0).pvalue
    many = int((chance < 0.01 / level.shape[1]).sum())
    if not many:
        return None
    worst = seen.columns.names[int(np.argmin(chance))]
    return (
        f"the first quarter of the demonstrations differs from the last in {many} of {level.shape[1]} columns, most in "
        f"{worst}: perhaps another session, setup or calibration, which is no fault"
    )
