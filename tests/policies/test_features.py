"""Feature maps: the columns are what they are called, and neither units nor the amount of data change the ridge."""

from functools import partial

import numpy as np
import pytest

from rpil.data.errors import DataError
from rpil.data.spaces import Discrete
from rpil.policies.features import FeatureMap, FeatureSettings, ridge_of

KINDS = ("raw", "folded", "nystroem")
RNG = np.random.default_rng(0)
X = RNG.normal(size=(200, 3)) * [1.0, 40.0, 0.01] + [0.0, 100.0, -5.0]
fit = partial(FeatureMap.fit, settings=FeatureSettings())


@pytest.mark.parametrize("offsets", [None, np.array([0, 100, 200])], ids=["of steps", "of demonstrations"])
def test_observations_that_cannot_be_squared_are_refused(offsets):
    for size, what in ((1e-300, "varies by less than 1e-150.*use smaller units"), (1e160, r"is beyond 1e\+150")):
        with pytest.raises(DataError, match=f"Observation 1 {what}"):
            fit("folded", X * [1.0, size, 1.0], offsets=offsets)
    small, usual = (fit("folded", X * size, offsets=offsets).design(X * size) for size in (1e-140, 1.0))
    np.testing.assert_allclose(small, usual, atol=1e-9)
    fit("folded", X * [1.0, 0.0, 1.0], offsets=offsets)  # a column that never changes is no such one


@pytest.mark.parametrize("kind", KINDS)
def test_columns_are_centred_and_the_last_is_the_constant(kind):
    design = fit(kind, X).design(X)
    np.testing.assert_allclose(design[:, :-1].mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_array_equal(design[:, -1], 1.0)
    np.testing.assert_allclose(design[:, :-1].std(axis=0), 1.0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_observation(kind):
    x = X.copy()
    x[:, 1] = 1e3 / 3
    found = fit(kind, x)
    assert np.isfinite(found.design(x)).all()
    assert np.abs(found.design(x)[:, :-1]).max() < 100
    touched = np.ptp(found.design(x)[:, :-1], axis=0) < 1e-3  # rounding errors are not blown up
    assert touched.sum() == 1


def test_two_values_are_not_folded():
    """Their distance from the mean says the same as they do."""
    x = np.column_stack([X, X[:, 0] > 0, np.where(X[:, 1] > 1, 7.0, -3.0)])
    found = fit("folded", x)
    assert found.folds.tolist() == [1, 1, 1, 0, 0]
    assert found.design(x).shape == (len(x), 5 + 3 + 1)


@pytest.mark.parametrize("kind", KINDS)
def test_units_do_not_change_the_design(kind):
    units, shift = np.array([1e-15, 1e3, 1e15]), np.array([3.0, 0.0, 0.0])
    plain, scaled = fit(kind, X).design(X), fit(kind, X * units).design(X * units)
    np.testing.assert_allclose(scaled, plain, atol=1e-6)
    np.testing.assert_allclose(fit(kind, X + shift).design(X + shift), plain, atol=1e-6)


@pytest.mark.parametrize("kind", ["raw", "folded"])  # landmarks are drawn from the rows
def test_a_weight_is_a_row_repeated(kind):
    weight = RNG.integers(1, 4, size=len(X))
    repeated = fit(kind, np.repeat(X, weight, axis=0))
    weighted = fit(kind, X, weight.astype(float))
    for field in ("location", "spread", "center", "scale"):
        np.testing.assert_allclose(getattr(weighted, field), getattr(repeated, field), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_ridge(kind):
    found = fit(kind, X)
    default, scaled = (ridge_of(found, C, 200.0, Discrete(3)) for C in (None, 4.0))
    np.testing.assert_allclose(default[:-1], 200 * FeatureSettings.ridge_per_step)
    # c_scaled = c * scale, so that a penalty c^2 / (2 C) is c_scaled^2 / (2 C scale^2)
    np.testing.assert_allclose(scaled[:-1], 0.25 / found.scale**2)
    assert default[-1] == scaled[-1] == 0.0
    assert len(default) == found.design(X).shape[1]


@pytest.mark.parametrize(("kind", "far", "order"), [(KINDS[0], 0.0, "C"), (KINDS[1], 1e3, "F"), (KINDS[2], 1e3, "C")])
def test_single_precision_is_as_good_as_double(kind, far, order):
    rng = np.random.default_rng(0)
    observations = rng.normal(far, 1.0, (9000, 3)).astype(np.float32, order=order)
    features = fit(kind, observations)
    double, single = features.design(observations.astype(float)), features.design(observations, single=True)
    np.testing.assert_array_equal(features.design(observations), double)
    assert (double.dtype, single.dtype) == (np.float64, np.float32)
    np.testing.assert_allclose(single, double, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(single[5000:5003], features.design(observations[5000:5003], single=True), atol=1e-6)
    assert single.flags.f_contiguous == (order == "F")


def test_landmarks_stand_where_there_is_something_to_see():
    """Nine steps in ten stand still; of landmarks that were drawn evenly, nine in ten would be there."""
    rng = np.random.default_rng(0)
    still, moving = 0.01 * rng.normal(size=(900, 2)), 3.0 * rng.normal(size=(100, 2))
    fitted = FeatureMap.fit("nystroem", np.concatenate([still, moving]), settings=FeatureSettings(n_landmarks=30))
    z = fitted.landmarks[:, :2] * fitted.spread + fitted.location
    assert len(z) == 30
    assert (np.abs(z).max(axis=1) < 0.1).sum() <= 5


@pytest.mark.parametrize("kind", KINDS)
def test_a_robust_map_sees_the_others_as_before_however_far_one_demonstration_is(kind):
    rng = np.random.default_rng(0)
    observations, offsets = rng.normal(size=(200, 3)), np.arange(0, 201, 20)
    near, wild = observations.copy(), observations.copy()
    near[:20] += 1e3
    wild[:20] += 1e9
    one, other = (fit(kind, rows, offsets=offsets) for rows in (near, wild))
    np.testing.assert_allclose(other.design(wild), one.design(near), atol=1e-9)
    plain = fit(kind, observations, offsets=offsets).design(observations)
    assert np.abs(one.design(near)[:, :3]).max() < max(9.0, np.abs(plain).max())
    heavy = rng.standard_t(2, size=(200, 3)).astype(np.float32)
    robust = fit(kind, heavy, offsets=offsets)
    np.testing.assert_allclose(robust.design(heavy, single=True), robust.design(heavy), atol=1e-4)
