"""Effective steps: how many independent steps carry as much information as the steps of a demonstration.

The variance of a mean over n steps is that of one step over n only where steps are independent. With autocovariances
g_k it is

    Var(mean) = (1 / n) [ g_0 + 2 sum_{k < n} (1 - k / n) g_k ],        n_eff = g_0 / Var(mean)

The autocovariances are pooled over demonstrations, around one mean: around the mean of each demonstration they would be
biased where demonstrations are short. They end where several consecutive lags are no larger than chance makes them (the
standard error of Bartlett 1946).
"""

from __future__ import annotations

import numpy as np

from rpil.inference.settings import EffectiveStepsSettings
from rpil.numerics.types import Array, Float, Int


def autocovariances(
    residual: Float[Array, " N"],
    offsets: Int[Array, " M1"],
    settings: EffectiveStepsSettings,
) -> Float[Array, " L"]:
    """Autocovariances g_0, g_1, ... of a series of expectation zero, such as log pi(a|s) - E log pi(.|s), pooled over
    demonstrations; demonstration m has the steps ``offsets[m]:offsets[m + 1]``."""
    lengths = np.diff(offsets)
    variance = float(residual @ residual) / len(residual)
    covariances, quiet, bartlett = [variance], 0, 1.0
    for lag in range(1, min(int(lengths.max()), settings.max_lags)):
        pairs = int(np.maximum(lengths - lag, 0).sum())
        if variance == 0.0 or pairs < settings.min_pairs:
            break
        value = _lagged_sum(residual, offsets, lag) / pairs
        covariances.append(value)
        chance = settings.standard_errors * variance * np.sqrt(bartlett / pairs)
        quiet = quiet + 1 if abs(value) < chance else 0
        if quiet == settings.quiet_lags:
            break
        bartlett += 2 * (value / variance) ** 2
    return np.array(covariances[: len(covariances) - quiet])


def _lagged_sum(residual: Array, offsets: Array, lag: int) -> float:
    """Sum of the products of steps `lag` apart within a demonstration."""
    total = np.concatenate([[0.0], np.cumsum(residual[lag:] * residual[:-lag])])
    begins = np.minimum(offsets[:-1], len(total) - 1)
    stops = np.clip(offsets[1:] - lag, begins, len(total) - 1)
    return float((total[stops] - total[begins]).sum())


def effective_steps(covariances: Float[Array, " L"], lengths: Int[Array, " M"]) -> Float[Array, " M"]:
    """n_eff of means over `lengths` steps; where the correlation is negative it is larger than the length."""
    if not covariances[0] > 0.0:
        return np.asarray(lengths, dtype=float)
    lags = np.arange(1, len(covariances))
    distinct, index = np.unique(lengths, return_inverse=True)
    summed = np.array([(np.maximum(1 - lags / n, 0.0) * covariances[1:]).sum() for n in distinct.tolist()])
    ratio = 1 + 2 * summed / covariances[0]
    # Estimated ratios may be negative; the rounding of a full period of a series bounds the certainty of its mean.
    return np.asarray((distinct / np.maximum(ratio, 1 / distinct))[index])
