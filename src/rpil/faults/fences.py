"""From where on a value is unusual among demonstrations: a fence above the quartiles (Tukey 1977), of ratios."""

from __future__ import annotations

import numpy as np

from rpil.faults.settings import FaultSettings
from rpil.numerics.types import Array


def fence(values: Array, factor: float, least: Array | float, settings: FaultSettings) -> Array:
    """Where values (M, ...) of demonstrations begin to be unusual; infinite where they differ too much to tell.

    With quartiles q1 and q3 over the demonstrations, and s = `least`, the size below which values do not differ:

        (q3 + s) max(factor, r),    r = ((q3 + s) / (q1 + s))^fence,    for r up to `max_spread`.
    """
    low, high = np.quantile(values, [0.25, 0.75], axis=0, method="lower") + least
    spread = (high / np.maximum(low, 1e-300)) ** settings.fence
    return np.asarray(np.where(spread <= settings.max_spread, high * np.maximum(factor, spread), np.inf))


def two_fences(values: Array, factor: float, settings: FaultSettings) -> tuple[Array, Array]:
    """Where positive values (M, ...) begin to be unusually small, and unusually large."""
    return 1.0 / fence(1.0 / values, factor, 0.0, settings), fence(values, factor, 0.0, settings)
