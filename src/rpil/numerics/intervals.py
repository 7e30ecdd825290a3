"""95 % intervals of a share and of a mean."""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit

from rpil.numerics.types import Float


def wilson(n_successes: int, n: int) -> tuple[float, float]:
    """Wilson's score interval of a probability, after `n_successes` of `n` independent trials.

    It lies within [0, 1] and has a width where all or none succeed (Wilson 1927).
    """
    from scipy.stats import binomtest  # takes half a second

    low, high = binomtest(n_successes, n).proportion_ci(0.95, method="wilson")
    return float(low), float(high)


def mean_interval(values: Float[np.ndarray, " N"]) -> tuple[float, float]:
    """The t interval of the mean of independent values; (nan, nan) for a single one."""
    n, mean = len(values), float(values.mean())
    if n == 1:
        return float("nan"), float("nan")
    half_width = float(stdtrit(n - 1, 0.975) * values.std(ddof=1) / np.sqrt(n))
    return mean - half_width, mean + half_width
