"""The rules about whole demonstrations: whether undoing a fault mends them, and what they are made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from rpil.faults.rules import AppliedRule, Measurements

TRIED = {
    "sign": {"sign": "{} has the other sign"},
    "exchanged": {"exchanged": "{} are exchanged"},
    "offset": {"offset": "{} is off by a constant: perhaps its zero has moved"},
    "shifted action": {
        "actions late": "the actions are one step late",
        "actions early": "the actions are one step early",
    },
    "reversed": {"reversed": "time is reversed: it runs backwards"},
    "frame rate": {"frame rate": "it has half the frame rate of the others: every other step is missing"},
}
"""Rule to the faults that are tried, and what is said of each."""

USUAL_NEXT_STATE = 0.75
"""Share of the actions that are the next state in the median demonstration, from which on that is usual: some actions,
of a hand, may be so always."""

FEW = (4, 0.1)
"""Demonstrations, or share of them, in which a column may never move before that is usual."""

MOST_STILL = 0.25
"""Share of the demonstrations in which a column never moves, up to which that is a fault."""


def compare_maps(seen: Measurements) -> Iterator[AppliedRule]:
    """Demonstrations that fit the map between states and actions of the others once a fault is undone."""
    namer, by = seen.learned.namer, seen.measured
    if namer is None:
        return
    tried, every = namer.tried, np.array(seen.columns.names)
    names, outside = every[namer.window.column], np.delete(every, namer.window.column)
    for rule, sentences in TRIED.items():
        own = np.flatnonzero(np.isin(tried.kind, [*sentences]))
        if not len(own):
            continue  # one column cannot be exchanged
        more = outside if tried.columns[own[0], 0] >= 0 else outside[:0]
        called = (*(" and ".join(names[c[c >= 0]]) for c in tried.columns[own]), *more)
        limit = np.append(np.nan_to_num(namer.limit[own], nan=np.inf), np.full(len(more), np.inf))
        if tried.columns[own[0], 0] < 0:  # a rule that knows one direction would miss the other
            limit[:] = np.where(np.isinf(limit).any(), np.inf, limit)
        value = np.pad(np.where(by.named[:, None] == own, by.gain[:, None], 0.0), ((0, 0), (0, len(more))))

        texts = [sentences[kind] for kind in tried.kind[own]]

        def say(m: int, k: int, texts: list[str] = texts, called: tuple[str, ...] = called) -> str:
            return f"{texts[k].format(called[k])}; undone, it fits the others"

        yield AppliedRule.above(rule, called, value, limit, seen.whole, say)


def compare_boundaries(seen: Measurements) -> Iterator[AppliedRule]:
    """Demonstrations that hold an end and then a beginning."""
    ends, by = seen.learned.ends, seen.measured
    limit = np.nan if ends is None else ends.limit
    step = by.boundary[:, 1].astype(int)
    unlike, m = by.boundary[:, :1], len(by.boundary)
    severity = np.where(unlike < limit, 1.0 + (limit - unlike), 0.0) if np.isfinite(limit) else np.full((m, 1), np.nan)
    yield AppliedRule(
        "two episodes",
        ("",),
        unlike,
        np.full((m, 1), limit),
        np.minimum(severity, 100.0),
        lambda m, _: (int(step[m]) - 1, int(step[m])),
        lambda m, _: f"step {step[m]} is like a beginning, and the one before like an end: perhaps two episodes in one",
    )


def compare_next_states(seen: Measurements) -> Iterator[AppliedRule]:
    """Demonstrations whose actions are the next state, where those of others are not."""
    moves, same = seen.measured.next_state.sum(axis=1).T
    share = same / np.maximum(moves, 1.0)
    usual = float(np.median(share))
    limit = (1.0 + usual) / 2 if usual < USUAL_NEXT_STATE else np.inf
    yield AppliedRule.above(
        "next state",
        ("",),
        share,
        np.asarray(limit),
        seen.whole,
        lambda m, _: f"{100 * share[m]:.0f} % of the actions that move are the state at the next step",
    )


def compare_ranges(seen: Measurements) -> Iterator[AppliedRule]:
    """MeasuredColumns that move in the others, about as far in each, and never in this one."""
    by, s, names = seen.measured, seen.settings, seen.columns.names
    ranges = by.high - by.low
    usual = np.median(ranges, axis=0)
    still = ranges <= s.least_range * usual
    low, high = np.where(still, np.inf, ranges).min(axis=0), ranges.max(axis=0)
    few = still.sum(axis=0) <= min(max(FEW[0], FEW[1] * len(still)), MOST_STILL * len(still))
    is_known = few & (low >= s.steady_range * usual) & (s.steady_range * high <= usual)
    yield AppliedRule.above(
        "never moves",
        names,
        still.astype(float),
        np.where(is_known & (usual > 0), 0.5, np.inf),
        seen.whole,
        lambda m, c: f"{names[c]} never moves, and in the others it does",
    )


MAP_COMPARISONS: tuple[Callable[[Measurements], Iterator[AppliedRule]], ...] = (
    compare_maps,
    compare_boundaries,
    compare_next_states,
    compare_ranges,
)
"""The rules that compare whole demonstrations."""
