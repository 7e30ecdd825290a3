"""The fit of the final policy by passes."""

from __future__ import annotations

import numpy as np

from rpil.scale.ascent import _time_left


def test_remaining_time_follows_the_gradient():
    assert _time_left(np.array([8.0, 4.0]), 0.5, 10.0) == ", about 30 s left"  # three halvings, ten seconds each
    assert _time_left(np.array([8.0]), 0.5, 10.0) == ""
    assert _time_left(np.array([4.0, 8.0]), 0.5, 10.0) == ""
