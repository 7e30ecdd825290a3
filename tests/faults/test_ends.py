"""How far a demonstration ends from the others."""

from __future__ import annotations

import numpy as np

from rpil.faults.measured_columns import Ends

ENDS = Ends(np.array([5.0, 0.0]), np.array([1.0, 2.0]))
"""Demonstrations that end at 5, and at 0."""


def test_the_distance_of_a_last_step_is_a_mean_over_columns_of_five_spreads_at_most():
    np.testing.assert_allclose(ENDS.far(np.array([[5.0, 7.0, 100.0], [0.0, 2.0, 100.0]])), [0.0, 2.5, 25.0])
