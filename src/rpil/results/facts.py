"""Facts about demonstrations beside the verdicts of an audit: they change none, and say nothing about quality.

Most are ranks within the demonstrations that were judged together, from 0 to 1: 1 is the longest, the one with the most
pauses, and so on. They are the ranks of the channels from which answers learn (`rpil.inference.channels`). By them it
is said too how two groups differ that each have a policy of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import ndtr

from rpil.data.text import listed, printable
from rpil.inference.channels import CHANNELS
from rpil.numerics.types import Array, Float, Int

RANKS: Mapping[str, tuple[str, int]] = {
    "length": ("length", 1),
    "pauses": ("motion", -1),
    "smoothness": ("smoothness", 1),
    "path": ("short path", -1),
}
"""Each fact that is a rank: the channel that it is read from, and whether it grows or falls with it."""

STYLES = {
    "pauses": ("fewer pauses", "more pauses"),
    "smoothness": ("less smooth", "smoother"),
    "path": ("shorter path", "longer path"),
}
"""The ranks that describe a style, and the words for low and for high ones."""

MIN_STYLE = 0.15
"""Distance of a median rank from the middle, 1/2, from which it is part of a style. Chosen by hand, not tuned."""

MIN_AT_LIMIT = 3
"""Demonstrations, at least, that share the largest length where there is a time limit: two may by chance."""

TIME_LIMIT = "time limit"

TWO_GROUPS = "The two groups: "
"""How the sentences begin."""

MAX_P = 0.01
"""Probability of so different facts by chance (Mann and Whitney 1947), up to which a difference is named."""
MIN_SEPARATION = 0.8
"""Share of the pairs of a demonstration of each group that differ in this direction, from which it is named."""
SAID_OF_B = {
    "length": ("takes longer", "is shorter"),
    "pauses": ("pauses more", "pauses less"),
    "smoothness": ("is smoother", "is less smooth"),
    "path": ("has a longer path", "has a shorter path"),
}
"""What is said of group B where the fact is larger, and where it is smaller, than in group A."""

Fact = float | int | str


def known_facts(
    columns: Float[Array, "M D"], lengths: Int[Array, " M"], order: Float[Array, " M"] | None
) -> dict[str, tuple[Fact, ...]]:
    """The facts about M demonstrations by name; those that are not known are left out.

    The names are those of `RANKS`; "time limit", 1 where the demonstration has the largest length, as several others
    do, else 0; and "order", the place among the demonstrations, from 1 on. `columns` are those of an audit, which begin
    with the normal scores of the channels.
    """
    found: dict[str, tuple[Fact, ...]] = {}
    if columns.shape[1] >= len(CHANNELS):
        for name, (channel, sign) in RANKS.items():
            ranks = ndtr(sign * columns[:, CHANNELS.index(channel)])
            found[name] = tuple(np.round(ranks, 6).tolist())
    is_longest = lengths == lengths.max()
    if MIN_AT_LIMIT <= is_longest.sum() < len(is_longest):  # probably cut off
        found[TIME_LIMIT] = tuple(is_longest.astype(int).tolist())
    if order is not None:
        found["order"] = tuple((np.searchsorted(np.sort(order), order) + 1).tolist())
    return found


def in_words(facts: Mapping[str, Sequence[Fact]], m: int) -> str:
    """The facts about demonstration `m` in one line, or nothing."""
    parts = [f"{name} {facts[name][m]:.2f}" for name in RANKS if name in facts]
    parts += ["time limit reached"] if TIME_LIMIT in facts and facts[TIME_LIMIT][m] else []
    parts += [f"session {printable(facts['session'][m])}"] if "session" in facts else []
    parts += [f"number {facts['order'][m]:,} of {len(facts['order']):,} in order"] if "order" in facts else []
    return ", ".join(parts)


def style_in_words(facts: Mapping[str, Sequence[Fact]], lengths: Int[Array, " M"], own: Sequence[int]) -> str:
    """How the demonstrations `own` differ from all of these `lengths`: in their median length, and in `STYLES`."""
    parts = [f"{np.median(lengths[list(own)]) / np.median(lengths):.2f} of the median length"]
    for name in (name for name in STYLES if name in facts):
        above = float(np.median([facts[name][m] for m in own])) - 0.5
        parts += [STYLES[name][above > 0]] if abs(above) >= MIN_STYLE else []
    return ", ".join(parts)


def groups_differ(
    groups: tuple[Int[Array, " A"], Int[Array, " B"]], columns: Float[Array, "M D"], lengths: Int[Array, " M"]
) -> tuple[str, ...]:
    """A sentence about the facts in which the groups A and B clearly differ; `columns` as in an audit."""
    from scipy.stats import mannwhitneyu  # takes as long to import as all else

    found, (first, second) = [], groups
    for name, (channel, sign) in RANKS.items():
        values = sign * columns[:, CHANNELS.index(channel)]
        test = mannwhitneyu(values[second], values[first])
        above = test.statistic / (len(first) * len(second))
        if test.pvalue <= MAX_P and max(above, 1 - above) >= MIN_SEPARATION:
            of_b, of_a = (np.median(lengths[group]) for group in (second, first))
            steps = f" (median {of_b:,.0f} against {of_a:,.0f} steps)"
            found.append(SAID_OF_B[name][int(above < 0.5)] + steps * (name == "length"))
    differ = f"B {listed(found)}" if found else "in length, pauses, smoothness and path they hardly differ"
    return (f"{TWO_GROUPS}{differ}.",)
