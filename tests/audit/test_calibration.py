"""Platt scaling finds a wrong slope and offset, changes little with few labels, and keeps the order."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import expit

from rpil.audit.calibration import PlattCalibration
from rpil.audit.settings import CalibrationSettings


def test_overconfident_log_odds_are_corrected():
    rng = np.random.default_rng(0)
    true = rng.normal(0.5, 1.5, size=4000)
    is_expert = rng.random(4000) < expit(true)
    reported = 5.0 * true - 2.0  # so true = (reported + 2) / 5
    calibration = PlattCalibration.fit(reported, is_expert, CalibrationSettings())
    assert calibration.slope == pytest.approx(0.2, rel=0.1)
    assert calibration.offset == pytest.approx(0.4, abs=0.1)


def test_calibrated_log_odds_and_few_labels_change_little():
    rng = np.random.default_rng(1)
    true = rng.normal(0.0, 2.0, size=4000)
    is_expert = rng.random(4000) < expit(true)
    calibration = PlattCalibration.fit(true, is_expert, CalibrationSettings())
    assert calibration.slope == pytest.approx(1.0, abs=0.1)
    assert calibration.offset == pytest.approx(0.0, abs=0.1)
    four = np.array([30.0, -30.0, 30.0, -30.0])
    four_labels = PlattCalibration.fit(four, four > 0, CalibrationSettings())
    assert four_labels.slope == pytest.approx(1.0, abs=0.01)
    assert four_labels.offset == pytest.approx(0.0, abs=0.01)


def test_labels_of_one_kind_do_not_diverge():
    # All six verdicts were wrong.
    calibration = PlattCalibration.fit(np.full(6, -1.0), np.ones(6, dtype=bool), CalibrationSettings())
    assert 0 < calibration.log_odds(np.array([-1.0]))[0] < 4
    assert 0.1 < calibration.slope < 1


def test_a_narrow_prior_keeps_slope_and_offset():
    settings = CalibrationSettings(log_slope_sd=1e-3, offset_sd=1e-3)
    calibration = PlattCalibration.fit(np.full(6, -1.0), np.ones(6, dtype=bool), settings)
    assert calibration.slope == pytest.approx(1.0, abs=1e-3)
    assert calibration.offset == pytest.approx(0.0, abs=1e-3)


def test_order_is_kept_beyond_the_largest_log_odds():
    z = np.array([-1e9, -300.0, -21.0, -20.0, 0.0, 19.9, 20.0, 25.0, 1e9])
    calibrated = PlattCalibration(0.1, 1.0, CalibrationSettings()).log_odds(z)
    assert (np.diff(calibrated) > 0).all()
    np.testing.assert_allclose(calibrated[[2, 4, 7]], [-1.0, 1.0, 3.0], atol=0.01)
