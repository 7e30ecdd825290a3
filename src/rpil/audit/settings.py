"""Settings of the audit: one record for each stage."""

from __future__ import annotations

from dataclasses import dataclass

from rpil.data.archive import stored


@stored()
@dataclass(frozen=True)
class CalibrationSettings:
    """Calibration of probabilities by labels (`rpil.audit.calibration`). All were chosen by hand, not tuned."""

    min_labels: int = 4
    """Labels that a calibration needs."""
    max_log_odds: float = 20.0
    """Nats. Log-odds beyond this are taken as this: as good as certain, whatever the model says."""
    log_slope_sd: float = 1.0
    """Standard deviation of log(slope) under the prior, which is normal with mean 0."""
    offset_sd: float = 2.0
    """Standard deviation of the offset under the prior, in nats; normal with mean 0."""
    tie_break: float = 1e-3
    """Nats by which calibrated log-odds keep the order beyond `max_log_odds`, times log(1 + excess)."""


@stored()
@dataclass(frozen=True)
class AuditSettings:
    """From probabilities to verdicts and step weights."""

    min_verdict_proba: float = 0.9
    """Probability from which a demonstration gets the upper word; the lower one from one minus this down.
    benchmarks/calibration.py measures how many words are then wrong."""
    min_label_log_odds: float = 20.0
    """Nats. A label raises the log-odds to at least this: as good as certain. Chosen by hand, not tuned."""
    full_weight_reliability: float = 0.9
    """Reliability, divided by that of a typical trusted one, from which every step has the full weight: a few unlikely
    steps are a misfit of the policy, and without them it would be biased to where it fits. Chosen by hand, not
    tuned."""
    calibration: CalibrationSettings = CalibrationSettings()
