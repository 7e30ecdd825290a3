"""Spaces of actions, and codes of actions."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.spaces import Box, action_space, encode_actions


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


X, OFFSETS = np.zeros((4, 1)), [0, 1, 4]
MOVES = Demonstrations(X, np.array([[0.0], [2.0], [1.0], [-1.0]]), OFFSETS, ids=["a", "b"])


def test_continuous_actions_have_a_box():
    space, classes = action_space(MOVES)
    assert (space.low.tolist(), space.high.tolist(), len(classes)) == ([-1], [2], 0)
    np.testing.assert_array_equal(encode_actions(classes, MOVES.actions, "a.csv"), MOVES.actions)


def test_actions_too_small_to_be_squared_are_refused():
    """One part alone is enough, and an offset does not help; a part that never changes is no such one."""
    still = np.full((4, 2), [1e-200, -1e-200])
    for size in (1e-300, 1e-155):
        actions = np.concatenate([still, MOVES.actions * size], axis=1)
        with pytest.raises(DataError, match=r"action 2 varies by less than 1e-150.*use smaller units"):
            action_space(Demonstrations(X, actions, OFFSETS, ids=["a", "b"]))
    small = Demonstrations(X, MOVES.actions * 1e-100, OFFSETS, ids=["a", "b"])
    assert action_space(small)[0].high.tolist() == [2e-100]


@pytest.mark.parametrize("classes", [[0, 1, 2], [2, 5, 7]])
def test_codes_are_places_among_the_classes(classes):
    classes = np.array(classes)
    np.testing.assert_array_equal(encode_actions(classes, classes[[2, 0, 1]], "a.csv"), [2, 0, 1])
    for unknown in (-1, 9):
        with pytest.raises(DataError, match=rf"a\.csv: action {unknown} is not among the fitted ones"):
            encode_actions(classes, np.array([classes[0], unknown]), "a.csv")
