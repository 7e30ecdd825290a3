"""Traces of long demonstrations have fewer points than steps, and say of which steps they are."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.results.traces import MAX_POINTS, Part, Traces, least_points, point_width, points


@pytest.mark.parametrize("n_steps", [1, MAX_POINTS, MAX_POINTS + 1, 4 * MAX_POINTS + 1])
def test_no_trace_has_more_points_than_allowed(n_steps: int) -> None:
    width = point_width(n_steps)
    found = points(np.ones(n_steps), width)
    assert len(found) <= MAX_POINTS
    assert (width == 1) == (n_steps <= MAX_POINTS)
    assert found.dtype == np.float32
    assert len(least_points(np.ones(n_steps), width)) == len(found)
    traces = Traces("continuous", (Part("elbow", 1.0, -2.0, found, found, found),), width)
    assert traces.step[-1] < n_steps <= traces.step[-1] + width


def test_a_point_is_the_mean_of_its_steps() -> None:
    np.testing.assert_array_equal(points(np.array([1.0, 3.0, 5.0, 6.0, 9.0]), 2), [2.0, 5.5, 9.0])
    np.testing.assert_array_equal(points(np.arange(6.0).reshape(3, 2), 2), [[1.0, 2.0], [4.0, 5.0]])


def test_the_least_step_of_each_point() -> None:
    assert least_points(np.array([0.4, 0.2, 0.3, 0.5, 0.1]), 2).tolist() == [1, 2, 4]
