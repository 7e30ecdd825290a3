"""Intervals: equal to SciPy's, with ends that are possible."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from rpil.simulation.rollouts import mean_interval, wilson


def test_wilson_by_hand():
    """The ends p of |k/n - p| = 1.96 sqrt(p (1 - p) / n)."""
    for end in wilson(3, 20):
        assert abs(3 / 20 - end) == pytest.approx(stats.norm.ppf(0.975) * np.sqrt(end * (1 - end) / 20))
    assert wilson(0, 7)[0] == 0
    assert wilson(7, 7)[1] == 1


def test_mean_interval_is_students():
    values = np.random.default_rng(0).normal(10, 3, size=25)
    wanted = stats.t.interval(0.95, 24, loc=values.mean(), scale=stats.sem(values))
    np.testing.assert_allclose(mean_interval(values), wanted, rtol=1e-12)


def test_one_value_has_no_interval():
    assert np.isnan(mean_interval(np.array([3.0]))).all()
