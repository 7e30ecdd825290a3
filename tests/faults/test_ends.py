"""Where one demonstration may end and another begin."""

from __future__ import annotations

import numpy as np

from rpil.faults.ends import Ends

ENDS = Ends(np.array([[0.0], [5.0]]), np.ones((2, 1)), (4.0, 6.0), 1.0)
"""Demonstrations of 4 to 6 steps go from 0 to 5."""


def test_the_most_alike_step_is_found_where_both_parts_are_as_long_as_demonstrations():
    values = np.array([[0.0, 2, 4, 5, 5, 0, 2, 3, 5, 5]])
    unlike, step = ENDS.boundary(values)
    assert step == 5
    assert np.isclose(unlike, -2 * np.log1p(5.0))
    assert ENDS.boundary(values[:, 1:])[1] == 4  # the only one that leaves four steps on both sides
    assert ENDS.boundary(values[:, :7]) == (np.inf, 0)
    assert ENDS.boundary(np.zeros((1, 13))) == (np.inf, 0)


def test_what_is_far_counts_no_more_than_five_spreads():
    unlike, step = ENDS.boundary(np.full((1, 9), 100.0))
    assert (unlike, step) == (50.0, 4)
