"""Columns of any type become the arrays that the library computes with."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.data.arrays import as_actions, as_array, as_ids, as_observations, as_offsets, check_finite
from rpil.data.errors import DataError


@pytest.mark.parametrize(
    ("values", "dtype", "shape"),
    [
        ([1, 2], np.int64, (2,)),
        ([True, False], np.int64, (2,)),
        ([1.0, 2.0], np.int64, (2,)),  # whole numbers
        ([[1], [2]], np.int64, (2,)),
        ([1.0, 2.5], np.float64, (2, 1)),
        ([[1.0], [2.0]], np.float64, (2, 1)),
        (np.ones((2, 3), dtype=np.float32), np.float32, (2, 3)),
        (["a", "b"], np.dtype("<U1"), (2,)),
    ],
)
def test_actions_are_discrete_or_continuous(values, dtype, shape):
    actions = as_actions(values, "a.csv")
    assert (actions.dtype, actions.shape) == (dtype, shape)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: as_array([[1], [1, 2]], "actions", "a"), "a: actions must be a rectangular array"),
        (lambda: as_array(np.array([1, "b"], object), "actions", "a"),
         "a: actions mix text with numbers"),
        (lambda: as_observations(["x"], "a"), "hold text where numbers are due"),
        (lambda: as_observations([1.0], "a"), r"with one per step use reshape\(-1, 1\)"),
        (lambda: as_actions(np.ones((2, 2, 2)), "a"), "neither .N,. discrete nor .N, A. floats"),
        (lambda: as_ids([1, "b"], "a"), "all whole numbers or all text"),
        (lambda: as_ids(["b", "b"], "a"), "'b' appears twice"),
        (lambda: as_offsets([0, 2, 2, 3], ("x", "y", "z"), 3, "a"), "demonstration 'y': it has no steps; leave it out"),
        (lambda: as_offsets([0, 2], ("x",), 3, "a"), "increase from 0 to the number of steps, 3"),
    ],
)  # fmt: skip
def test_what_is_no_such_array_is_refused(call, match):
    with pytest.raises(DataError, match=match):
        call()


def test_the_first_value_that_is_not_finite_is_named():
    values = np.zeros((5, 2))
    check_finite(values, ("x", "y"), np.array([0, 2, 5]), ("a", "b"), "a.csv")
    values[3, 1] = np.inf
    with pytest.raises(DataError, match=r"a\.csv, demonstration 'b', step 1: y is inf; repair the value"):
        check_finite(values, ("x", "y"), np.array([0, 2, 5]), ("a", "b"), "a.csv")
