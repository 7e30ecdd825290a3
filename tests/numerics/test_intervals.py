"""Intervals: equal to SciPy's, with ends that are possible."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from rpil.numerics.intervals import mean_interval, wilson


@pytest.mark.parametrize(("k", "n"), [(0, 1), (1, 1), (0, 20), (3, 20), (20, 20), (71, 300)])
def test_wilson_is_scipys_and_within_zero_and_one(k, n):
    wanted = stats.binomtest(k, n).proportion_ci(0.95, method="wilson")
    low, high = wilson(k, n)
    np.testing.assert_allclose((low, high), (wanted.low, wanted.high), atol=1e-12)
    assert 0 <= low < high <= 1


def test_the_ends_are_exact_where_none_or_all_succeed():
    assert wilson(0, 7)[0] == 0
    assert wilson(7, 7)[1] == 1


def test_mean_interval_is_students():
    values = np.random.default_rng(0).normal(10, 3, size=25)
    wanted = stats.t.interval(0.95, 24, loc=values.mean(), scale=stats.sem(values))
    np.testing.assert_allclose(mean_interval(values), wanted, rtol=1e-12)


def test_one_value_has_no_interval():
    assert np.isnan(mean_interval(np.array([3.0]))).all()
