"""Facts about demonstrations beside the words of an audit: they change no word, and say nothing about quality.

Each is a rank within the demonstrations that were judged together, from 0 to 1: 1 is the longest, the one with the most
pauses, and so on. They are the ranks of the channels from which answers learn (`rpil.inference.channels`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import norm, rankdata

from rpil.audit.text import printable
from rpil.inference.channels import CHANNELS
from rpil.numerics.types import Array, Float

RANKS: Mapping[str, tuple[str, int]] = {
    "length": ("length", 1),
    "pauses": ("motion", -1),
    "smoothness": ("smoothness", 1),
    "path": ("short path", -1),
    "unusual end": ("common end", -1),
}
"""Each fact that is a rank: the channel that it is read from, and whether it grows or falls with it."""

Fact = float | int | str


def known_facts(
    columns: Float[Array, "M D"], sessions: Sequence[str], order: Float[Array, " M"] | None
) -> dict[str, tuple[Fact, ...]]:
    """The facts about M demonstrations by name; those that are not known are left out.

    The names are those of `RANKS`, "session", and "order": the place among the demonstrations, from 1 on. `columns` are
    those of an audit, which begin with the normal scores of the channels.
    """
    found: dict[str, tuple[Fact, ...]] = {}
    if columns.shape[1] >= len(CHANNELS):
        for name, (channel, sign) in RANKS.items():
            ranks = norm.cdf(sign * columns[:, CHANNELS.index(channel)])
            found[name] = tuple(np.round(ranks, 6).tolist())
    if len(sessions):
        found["session"] = tuple(sessions)
    if order is not None:
        found["order"] = tuple(rankdata(order, method="min").astype(int).tolist())
    return found


def in_words(facts: Mapping[str, Sequence[Fact]], m: int) -> str:
    """The facts about demonstration `m` in one line, or nothing."""
    parts = [f"{name} {facts[name][m]:.2f}" for name in RANKS if name in facts]
    parts += [f"session {printable(facts['session'][m])}"] if "session" in facts else []
    parts += [f"number {facts['order'][m]:,} of {len(facts['order']):,} in order"] if "order" in facts else []
    return ", ".join(parts)
