"""Weighted ridge regression and Student's errors."""

import numpy as np
import pytest
from scipy.stats import norm, rankdata
from scipy.stats import t as student

from rpil.numerics import regression

RNG = np.random.default_rng(0)
OFFSETS = np.arange(0, 101, 20)  # five demonstrations of 20 steps


def test_robust_scale_of_gaussian_steps_and_of_constants():
    values = np.column_stack([RNG.normal(5.0, 3.0, 100), np.full(100, 0.1), np.repeat([1.0, 1.0, 1.0, 1.0, 3.0], 20)])
    location, spread = regression.robust_scale(values, OFFSETS)
    np.testing.assert_allclose(location, [5.0, 0.1, 1.0], atol=1.0)
    np.testing.assert_allclose(spread, [3.0, 1.0, 2.0], rtol=0.3)


@pytest.mark.parametrize("n", [1, 2, 7, 8])
def test_medians_are_those_of_numpy(n):
    values = RNG.normal(size=(3, n, 2)).transpose(0, 2, 1)
    np.testing.assert_array_equal(regression.medians(values), np.median(values, axis=-1))


def test_mean_ranks_are_those_of_scipy():
    values = np.array([3.0, 1.0, 3.0, -2.0, 3.0, 1.0])
    np.testing.assert_array_equal(regression.mean_ranks(values), rankdata(values))


def test_spread_within_ignores_the_levels_of_demonstrations():
    values = RNG.normal(0.0, 2.0, 100) + np.repeat(50.0 * np.arange(5), 20)
    assert regression.spread_within(values[:, None], OFFSETS) == pytest.approx(2.0, rel=0.3)
    assert regression.robust_scale(values[:, None], OFFSETS)[1] > 40
    levels = np.repeat([0.1, 0.2, 0.3, 0.4, 0.5], 20)[:, None]  # constant within each
    assert regression.spread_within(levels, OFFSETS) == pytest.approx(0.1)


@pytest.mark.parametrize("scale", [lambda *steps: regression.robust_scale(*steps)[1], regression.spread_within])
def test_one_demonstration_has_no_influence_however_far_it_is(scale):
    values = RNG.normal(size=(100, 1))
    near, far = values.copy(), values.copy()
    near[:20] += 1e3
    far[:20] += 1e9
    np.testing.assert_array_equal(scale(near, OFFSETS), scale(far, OFFSETS))


def test_solve_ridge_minimises_the_penalised_squares():
    features = np.column_stack([RNG.normal(size=(50, 2)), np.ones(50)])
    actions, weight = RNG.normal(size=(50, 2)) + 3.0, RNG.random(50)
    found = regression.solve_ridge(*regression.normal_equations(features, actions, weight), 0.1)
    penalty = 0.1 * weight.sum() * np.array([[1.0], [1.0], [0.0]])
    slope = features.T @ (weight[:, None] * (features @ found - actions)) + penalty * found
    np.testing.assert_allclose(slope, 0.0, atol=1e-6)
    weightless = regression.normal_equations(features, actions, np.zeros(50))
    np.testing.assert_array_equal(regression.solve_ridge(*weightless, 0.1), 0.0)


def test_error_scale_is_robust_and_weighted():
    errors = RNG.normal(0.0, 2.0, (10_000, 1))
    clean = regression.error_scale(errors, np.ones(10_000), regression.ErrorSettings(min_scale=0.0))
    assert clean == pytest.approx(1.35 * 2.0 * norm.ppf(0.75), rel=0.03)
    assert regression.error_scale(errors, np.zeros(10_000), regression.ErrorSettings(min_scale=0.0)) == clean
    least = regression.error_scale(errors, np.ones(10_000), regression.ErrorSettings(min_scale=0.5))
    assert least == pytest.approx(clean + 0.5)
    spoiled = np.where(np.arange(10_000)[:, None] < 1_000, 1e6, errors)
    assert regression.error_scale(spoiled, np.ones(10_000), regression.ErrorSettings()) < 1.3 * clean
    ignored = regression.error_scale(spoiled, (np.arange(10_000) >= 1_000).astype(float), regression.ErrorSettings())
    assert ignored == pytest.approx(clean + 0.03, rel=0.05)


@pytest.mark.parametrize("nu", [1.0, 4.0, 30.0])
def test_student_log_density_is_scipys(nu):
    errors, scale = RNG.normal(size=(20, 2)), np.array([0.5, 3.0])
    found = regression.student_log_densities(errors, scale, regression.ErrorSettings(degrees_of_freedom=nu)).sum(axis=1)
    np.testing.assert_allclose(found, student.logpdf(errors, nu, scale=scale).sum(axis=1))
