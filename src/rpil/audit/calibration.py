"""P(expert) corrected by demonstrations of known quality that the fit was not told about.

The log-odds of an audit rest on the assumption that the group that agrees best is good, and on a model of its scores;
where these are wrong they may rank well and be too sure, or not sure enough. Labels that were kept back tell: a slope
and an offset of the log-odds are fitted to them (Platt 1999), both under a prior that keeps them at 1 and 0, so that
few labels change little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import log_expit

from rpil.numerics.types import Array

FEWEST = 4
"""Labels needed, at least."""

_SURE = 20.0
"""Log-odds from which all are alike: as good as certain. Beyond, they keep their order and no more."""

_SLOPE_SPREAD = 1.0
_OFFSET_SPREAD = 2.0
"""Standard deviations of log slope and offset beforehand."""

_ORDER = 1e-3


@dataclass(frozen=True)
class Recalibration:
    """logit P(expert) = slope * log-odds + offset.

    Attributes
    ----------
    slope : float
        Below 1 where the log-odds are too sure.
    offset : float
        Above 0 where they trust too few.
    """

    slope: float = 1.0
    offset: float = 0.0

    @classmethod
    def fit(cls, log_odds: Array, expert: Array) -> Recalibration:
        """The most likely one for demonstrations with these `log_odds` (L,), `expert` (L,) bool being true of them."""
        z, sign = np.clip(log_odds, -_SURE, _SURE), np.where(expert, 1.0, -1.0)

        def loss(at: Array) -> float:
            log_slope, offset = at
            missed = -log_expit(sign * (np.exp(log_slope) * z + offset)).sum()
            return float(missed + 0.5 * (log_slope / _SLOPE_SPREAD) ** 2 + 0.5 * (offset / _OFFSET_SPREAD) ** 2)

        log_slope, offset = minimize(loss, np.zeros(2), method="BFGS").x
        return cls(float(np.exp(log_slope)), float(offset))

    def log_odds(self, log_odds: Array) -> Array:
        """What `log_odds` (M,) should have been, in the same order."""
        z = np.clip(log_odds, -_SURE, _SURE)
        beyond = _ORDER * np.sign(z) * np.log1p(np.abs(log_odds - z))
        corrected: Array = self.slope * z + self.offset + beyond
        return corrected
