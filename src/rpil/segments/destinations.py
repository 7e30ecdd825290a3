"""Progress of acts: whether things lie afterwards where others leave them, rather than where others take them from."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from rpil.numerics.types import Array, Bool, Float, Int
from rpil.segments.settings import SegmentSettings


def progress(
    after: Float[Array, "N C"],
    before: Float[Array, "N C"],
    moved: Bool[Array, "N C"],
    demonstration: Int[Array, " N"],
    settings: SegmentSettings,
) -> Float[Array, " N"]:
    """Progress of N acts, sorted by demonstration, in nats: the mean of log f - log g over the columns that each moves.

    f is the density, at the value that it leaves, of the values that acts of other demonstrations leave, and g of those
    that they take; NaN where fewer than `least_acts` move any of its columns.
    """
    total, count = np.zeros(len(after)), np.zeros(len(after))
    for c in np.flatnonzero(moved.any(axis=0)):
        own = moved[:, c]
        at, of = after[own, c], demonstration[own]
        f, g = (near(at, values[own, c], of, settings.near) + 2 * settings.near for values in (after, before))
        tells = len(at) - np.bincount(of)[of] >= settings.least_acts
        total[own] += np.where(tells, np.log(f / g), 0.0)
        count[own] += tells
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def near(
    at: Float[Array, " K"], values: Float[Array, " K"], demonstration: Int[Array, " K"], width: float
) -> Int[Array, " K"]:
    """How many values of other demonstrations lie within `width` of each of `at`."""
    ordered, low, high = np.sort(values), at - width, at + width
    counts = np.searchsorted(ordered, high, side="right") - np.searchsorted(ordered, low)
    for a, b in pairwise(np.flatnonzero(np.diff(demonstration, prepend=-1, append=-1)).tolist()):
        counts[a:b] -= ((values[a:b] >= low[a:b, None]) & (values[a:b] <= high[a:b, None])).sum(axis=1)
    return counts
