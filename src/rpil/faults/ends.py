"""How demonstrations begin and end, to find two in one."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from rpil.faults.measured_columns import MovingBlock
from rpil.numerics.types import Array, Float

FARTHEST = 25.0
"""Squared distance in one column, in spreads, at most."""

NORMAL_DEVIATION = 0.6745
"""Median distance from the median of a normal distribution of standard deviation 1."""

LEAST_SPREAD = 0.02
"""Standard deviations of a column by which first, and last, steps do not differ."""

UNUSUAL_LENGTHS = 0.02
"""Share of the demonstrations that are unusually short, and long."""

LENGTH_MARGIN = 0.1
"""By how much a joined demonstration may be unusually short or long."""

LARGE_CHANGE = 0.99
"""Quantile of the changes from step to step, in which a leap is measured."""

GAP_SHARE, LEAST_GAP = 0.1, 1.0
"""The limit lies so far from joined demonstrations towards clean ones; with a smaller gap between the two nothing is
known."""


@dataclass(frozen=True, eq=False)
class Ends:
    """How demonstrations begin and end, (2, C) for first and last steps, and how long they are.

    `limit`: threshold below which the best split point counts as a joint of two episodes; NaN if clean and joined ones
    overlap.
    """

    centre: Float[Array, "2 C"]
    spread: Float[Array, "2 C"]
    lengths: tuple[float, float]
    leap: float
    limit: float = np.nan

    def far(self, rows: Float[Array, "2 C K"]) -> Float[Array, "2 K"]:
        """Squared distances of steps from first, and of others from last steps, in spreads."""
        off = (rows - self.centre[:, :, None]) / self.spread[:, :, None]
        return np.asarray(np.minimum(off**2, FARTHEST).mean(axis=1))

    def boundary(self, values: Float[Array, "C T"]) -> tuple[float, int]:
        """Score of the most boundary-like step (smaller is more alike), and that step."""
        n = values.shape[1]
        low, high = self.lengths
        first, end = int(max(low, n - high)), int(min(high, n - low))
        if first < 1 or first >= end:
            return np.inf, 0
        rows = np.stack([values[:, first:end], values[:, first - 1 : end - 1]])  # a beginning, after an end
        wide = self.spread.max(axis=0)[:, None]
        leaps = np.log1p(np.sqrt((((rows[0] - rows[1]) / wide) ** 2).mean(axis=0)) / self.leap)
        unlike = self.far(rows).sum(axis=0) - 2.0 * leaps
        at = int(np.argmin(unlike))
        return float(unlike[at]), first + at


def learn_ends(sample: MovingBlock) -> Ends | None:
    """Of a sample; the limit lies between its demonstrations and pairs of them, joined."""
    s, columns, offsets = sample.settings, sample.columns, sample.offsets
    if len(offsets) <= s.min_demonstrations or columns.is_action.all():
        return None
    values = sample.values[~columns.is_action]
    least = LEAST_SPREAD * columns.spread[~columns.is_action]
    ends = np.stack([values[:, offsets[:-1]], values[:, offsets[1:] - 1]])
    centre = np.median(ends, axis=2)
    spread = np.median(np.abs(ends - centre[:, :, None]), axis=2) / NORMAL_DEVIATION + least
    wide = spread.max(axis=0)[:, None]
    change = np.sqrt(((np.diff(values, axis=1) / wide) ** 2).mean(axis=0))
    lengths = np.quantile(np.diff(offsets), [UNUSUAL_LENGTHS, 0.25, 0.75, 1 - UNUSUAL_LENGTHS])
    ratio = lengths[2] / lengths[1]
    short, long = max(lengths[0], lengths[1] / ratio), min(lengths[3], lengths[2] * ratio)
    bounds = (1 - LENGTH_MARGIN) * short, (1 + LENGTH_MARGIN) * long
    leap = float(np.quantile(change, LARGE_CHANGE)) + 1e-12
    fitted = Ends(centre, spread, bounds, leap)
    each = [values[:, a:b] for a, b in itertools.pairwise(offsets)][: s.map_sample]
    clean = np.minimum([fitted.boundary(x)[0] for x in each], 1e3)
    joined = np.minimum([fitted.boundary(np.concatenate(p, axis=1))[0] for p in itertools.pairwise(each)], 1e3)
    (low, middle), high = np.quantile(clean, [0.25, 0.5]), np.quantile(joined, 0.75)
    limit = min(high + GAP_SHARE * (min(low, high + FARTHEST) - high), low - s.tail * (middle - low))
    return replace(fitted, limit=float(limit) if low > high + LEAST_GAP and limit > np.median(joined) else np.nan)
