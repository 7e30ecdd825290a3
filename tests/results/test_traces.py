"""Traces of long demonstrations have fewer points than steps, and say of which steps they are."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.results.judged import MAX_POINTS, bin_means, bin_starts


@pytest.mark.parametrize("n_steps", [1, 7, MAX_POINTS, MAX_POINTS + 1, 12345])
def test_points_are_nearly_equal_and_hold_every_step(n_steps: int) -> None:
    starts = bin_starts(n_steps)
    widths = np.diff(np.append(starts, n_steps))
    assert len(starts) == min(n_steps, MAX_POINTS)
    assert starts[0] == 0
    assert widths.min() >= 1
    assert widths.max() - widths.min() <= 1


def test_a_point_is_the_mean_of_its_steps() -> None:
    values = np.random.default_rng(0).normal(size=2 * MAX_POINTS)
    np.testing.assert_allclose(bin_means(values), values.reshape(-1, 2).mean(axis=1))
    np.testing.assert_array_equal(bin_means(values[:9]), values[:9])
