"""What actions there are, and what may be done."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.data.spaces import Box, Discrete


def test_the_most_likely_of_k_actions():
    outputs = np.log([[0.2, 0.5, 0.3], [0.6, 0.1, 0.3]])
    np.testing.assert_array_equal(Discrete(3).act(outputs), [1, 0])
    assert Discrete(3).bounded(outputs) is outputs
    assert Discrete(3) == Discrete(3) != Discrete(2)


def test_a_box_keeps_what_is_done_within_its_bounds():
    box = Box(np.array([-1.0, 0.0]), np.array([1.0, 4.0]))
    outputs = np.array([[-3.0, 2.0], [0.5, 9.0]])
    for kept in (box.act(outputs), box.bounded(outputs)):
        np.testing.assert_array_equal(kept, [[-1.0, 2.0], [0.5, 4.0]])
    assert box.log_volume == pytest.approx(np.log(8.0))


def test_the_box_around_actions_has_a_volume_also_where_a_part_never_moves():
    box = Box.around(np.array([[1.0, 7.0], [3.0, 7.0], [-2.0, 7.0]]))
    np.testing.assert_array_equal(box.low, [-2.0, 6.5])
    np.testing.assert_array_equal(box.high, [3.0, 7.5])
    assert box.log_volume == pytest.approx(np.log(5.0))
