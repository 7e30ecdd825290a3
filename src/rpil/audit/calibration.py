"""Calibration of the probabilities by demonstrations of known quality whose labels the fit did not see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import log_expit

from rpil.audit.settings import CalibrationSettings
from rpil.numerics.types import Array, Bool, Float


@dataclass(frozen=True)
class PlattCalibration:
    """Platt scaling (Platt 1999) of log-odds z with a prior on its two parameters.

        logit P(good) = slope z + offset,    log slope ~ N(0, log_slope_sd^2),    offset ~ N(0, offset_sd^2)

    The prior keeps slope and offset near 1 and 0 where there are few labels.
    """

    slope: float  # below 1 where the log-odds are too far from zero: overconfident
    offset: float  # nats; above 0 where too few demonstrations have positive log-odds
    settings: CalibrationSettings

    @classmethod
    def fit(
        cls,
        log_odds: Float[Array, " L"],
        is_good: Bool[Array, " L"],
        settings: CalibrationSettings,
    ) -> PlattCalibration:
        """The maximum of the posterior, given the log-odds of L labelled demonstrations and their labels."""
        z = np.clip(log_odds, -settings.max_log_odds, settings.max_log_odds)
        sign = np.where(is_good, 1.0, -1.0)

        def negative_log_posterior(parameters: Array) -> float:
            log_slope, offset = parameters
            loss = -log_expit(sign * (np.exp(log_slope) * z + offset)).sum()
            loss += 0.5 * (log_slope / settings.log_slope_sd) ** 2
            return float(loss + 0.5 * (offset / settings.offset_sd) ** 2)

        log_slope, offset = minimize(negative_log_posterior, np.zeros(2), method="BFGS").x
        return cls(float(np.exp(log_slope)), float(offset), settings)

    def log_odds(self, log_odds: Float[Array, " M"]) -> Float[Array, " M"]:
        """Calibrated log-odds, in the same order."""
        z = np.clip(log_odds, -self.settings.max_log_odds, self.settings.max_log_odds)
        tie_break = self.settings.tie_break * np.sign(z) * np.log1p(np.abs(log_odds - z))
        return np.asarray(self.slope * z + self.offset + tie_break)
