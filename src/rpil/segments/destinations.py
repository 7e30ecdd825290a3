"""Progress of acts: whether things lie afterwards where others leave them, rather than where others take them from.

Of each column that an act moves: log f(value) - log g(value), where f is the density of the values at which acts of
other demonstrations leave this column, and g that of the values from which they take it. The mean over the columns is
the progress of a state; it needs no reward, no film and no model of the task.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from rpil.numerics.types import Array, Bool, Float, Int
from rpil.segments.settings import SegmentSettings


def progress(
    states: Float[Array, "N C"],
    after: Float[Array, "N C"],
    before: Float[Array, "N C"],
    moved: Bool[Array, "N C"],
    demonstration: Int[Array, " N"],
    settings: SegmentSettings,
) -> Float[Array, " N"]:
    """The progress of a state of each of N acts, by the columns that it moves and the acts of other demonstrations;
    NaN where it moves nothing that others move. Acts are sorted by demonstration."""
    total, count = np.zeros(len(states)), np.zeros(len(states))
    for c in np.flatnonzero(moved.any(axis=0)):
        own = moved[:, c]
        f, n = near(states[own, c], after[own, c], demonstration[own], settings.near)
        g, _ = near(states[own, c], before[own, c], demonstration[own], settings.near)
        usual = settings.prior_acts * 2 * settings.near
        total[own] += np.where(n >= settings.least_acts, np.log((f + usual) / (g + usual)), 0.0)
        count[own] += n >= settings.least_acts
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def near(
    at: Float[Array, " K"], values: Float[Array, " K"], demonstration: Int[Array, " K"], width: float
) -> tuple[Int[Array, " K"], Int[Array, " K"]]:
    """How many values of other demonstrations lie within `width` of each of `at`, and how many these have."""
    ordered, n = np.sort(values), np.empty(len(at), dtype=int)
    counts = np.searchsorted(ordered, at + width, side="right") - np.searchsorted(ordered, at - width)
    edges = np.flatnonzero(np.diff(demonstration, prepend=-1, append=-1))
    for a, b in pairwise(edges.tolist()):
        counts[a:b] -= (np.abs(at[a:b, None] - values[a:b]) <= width).sum(axis=1)
        n[a:b] = len(at) - (b - a)
    return counts, n
