"""95 % intervals of a share and of a mean."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri, stdtrit

from rpil.numerics.types import Float

UPPER = 0.975
"""The quantile at the upper end of a 95 % interval."""

Interval = tuple[float, float]


def wilson(n_successes: int, n: int) -> Interval:
    """Wilson's score interval of a probability, after `n_successes` of `n` independent trials.

    It lies within [0, 1] and has a width where all or none succeed (Wilson 1927).
    """
    z2 = float(ndtri(UPPER)) ** 2
    share = n_successes / n
    center = (share + z2 / (2 * n)) / (1 + z2 / n)
    half_width = np.sqrt(z2 * (share * (1 - share) / n + z2 / (4 * n * n))) / (1 + z2 / n)
    # Where none or all succeed one end is 0 or 1, which rounding would miss.
    low = 0.0 if n_successes == 0 else float(center - half_width)
    return low, 1.0 if n_successes == n else float(center + half_width)


def mean_interval(values: Float[np.ndarray, " N"]) -> Interval:
    """The t interval of the mean of independent values; (nan, nan) for a single one."""
    n, mean = len(values), float(values.mean())
    if n == 1:
        return float("nan"), float("nan")
    half_width = float(stdtrit(n - 1, UPPER) * values.std(ddof=1) / np.sqrt(n))
    return mean - half_width, mean + half_width
