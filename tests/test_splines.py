"""Splines of all columns at once are scikit-learn's, to the last bit, within the knots and beyond."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.preprocessing import SplineTransformer

from rpil.splines import CubicSplines


@pytest.mark.parametrize(("width", "shift"), [(1.0, 0.0), (40.0, 1e5), (1e-9, -3.0)])
@pytest.mark.parametrize("n_columns", [1, 5])
def test_the_bits_are_scikit_learns(width, shift, n_columns):
    x = np.random.default_rng(0).normal(shift, width, size=(2500, n_columns))  # several blocks
    knots = np.linspace(x.min(axis=0), x.max(axis=0), 8)
    x = np.concatenate([x, knots, x - 5 * width, x + 5 * width])
    theirs = SplineTransformer(degree=3, knots=knots, extrapolation="linear").fit(knots).transform(x)
    np.testing.assert_array_equal(CubicSplines(knots).design(x), theirs)


def test_a_row_is_the_same_alone_and_among_others():
    x = np.random.default_rng(1).normal(size=(1500, 3))
    splines = CubicSplines(np.linspace(x.min(axis=0), x.max(axis=0), 8))
    together = splines.design(x)
    for k in (0, 1023, 1024, 1499):
        np.testing.assert_array_equal(splines.design(x[k : k + 1])[0], together[k])


def test_knots_that_the_precision_cannot_tell_apart():
    """Between 2^53 and 2^53 + 2 there is no number: some intervals are empty, and must not divide by their width."""
    knots = np.linspace([2.0**53], [2.0**53 + 2], 8)
    found = CubicSplines(knots).design(np.array([[2.0**53], [2.0**53 + 2]]))
    assert np.isfinite(found).all()
