"""How many independent steps a demonstration is worth.

The variance of a mean over n steps is that of one step over n only where steps are independent. With autocovariances
g_k it is

    Var(mean) = (1 / n) [ g_0 + 2 sum_{k < n} (1 - k / n) g_k ],        n_eff = g_0 / Var(mean)

The autocovariances are pooled over demonstrations, around zero or a mean of all of them: subtracting the mean of each
demonstration would take away from short ones what is to be measured. They end where several lags in a row are no
larger than chance makes them (the standard error of Bartlett 1946).
"""

from __future__ import annotations

import numpy as np

from rpil.numerics.types import Array

MOST_LAGS = 1_000
"""Lags beyond which nothing is summed: there a long memory is not told from a drift."""

LEAST_PAIRS = 30
"""Products from which an autocovariance is estimated."""

QUIET_LAGS = 4
"""Lags in a row without correlation after which there is none: a series may pause at every other lag."""

STANDARD_ERRORS = 1.5
"""Standard errors within which a correlation is taken for chance."""


def autocovariances(residual: Array, offsets: Array) -> Array:
    """Autocovariances g_0, g_1, ... of a series with mean zero (N,), pooled over demonstrations, (L,).

    Parameters
    ----------
    residual : (N,) array
        Values of expectation zero, such as log pi(a|s) - E log pi(.|s).
    offsets : (M + 1,) int array
        Demonstration m owns the steps ``offsets[m]:offsets[m + 1]``.
    """
    lengths = np.diff(offsets)
    variance = float(residual @ residual) / len(residual)
    found, quiet, bartlett = [variance], 0, 1.0
    for lag in range(1, min(int(lengths.max()), MOST_LAGS)):
        pairs = int(np.maximum(lengths - lag, 0).sum())
        if variance == 0.0 or pairs < LEAST_PAIRS:
            break
        value = _lagged(residual, offsets, lag) / pairs
        found.append(value)
        chance = STANDARD_ERRORS * variance * np.sqrt(bartlett / pairs)
        quiet = quiet + 1 if abs(value) < chance else 0
        if quiet == QUIET_LAGS:
            break
        bartlett += 2 * (value / variance) ** 2
    return np.array(found[: len(found) - quiet])


def _lagged(residual: Array, offsets: Array, lag: int) -> float:
    """Sum of the products of steps `lag` apart within a demonstration."""
    total = np.concatenate([[0.0], np.cumsum(residual[lag:] * residual[:-lag])])
    begins = np.minimum(offsets[:-1], len(total) - 1)
    stops = np.clip(offsets[1:] - lag, begins, len(total) - 1)
    return float((total[stops] - total[begins]).sum())


def effective_steps(covariances: Array, lengths: Array) -> Array:
    """Independent steps that means over `lengths` (M,) steps are worth, (M,); negative correlation gives more."""
    if not covariances[0] > 0.0:
        return np.asarray(lengths, dtype=float)
    lags = np.arange(1, len(covariances))
    distinct, index = np.unique(lengths, return_inverse=True)
    summed = np.array([(np.maximum(1 - lags / n, 0.0) * covariances[1:]).sum() for n in distinct.tolist()])
    ratio = 1 + 2 * summed / covariances[0]
    # Estimated sums may come out negative; no mean is more certain than the rounding of a full period.
    found: Array = (distinct / np.maximum(ratio, 1 / distinct))[index]
    return found
