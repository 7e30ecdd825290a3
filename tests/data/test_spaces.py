"""Spaces of actions: what a model and the simulator ask of them; and codes of actions and labels."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.spaces import Box, Discrete, action_space, encode_actions


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


def test_discrete_actions_may_start_anywhere():
    space = Discrete(3, start=5)
    np.testing.assert_array_equal(space.flip(np.array([5, 6, 7])), [7, 6, 5])
    np.testing.assert_array_equal(space.shift(np.array([5, 6, 7])), [6, 7, 5])
    assert set(space.draw(200, np.random.default_rng(0))) == {5, 6, 7}


@pytest.mark.parametrize("answer", [[5, 7], [5.0, 7.0], np.array([5, 7], dtype=np.uint8)])
def test_whole_numbers_among_the_actions_are_executed(answer):
    actions = Discrete(3, start=5).executed(np.asarray(answer), 2)
    assert actions.dtype == np.int64
    np.testing.assert_array_equal(actions, [5, 7])


CLASSES, TWO_NUMBERS = Discrete(3, start=5), Box(np.float32([-1, 0]), np.float32([1, 10]))
NO_CLASSES = [[0, 5], [5, 8], [5.5, 6], [np.nan, 5], [np.inf, 5], [[5], [6]], [5]]
NO_ROW = [[0.0, 0.0], [[0.0]], [[0.0, np.nan]], [[-np.inf, 0.0]], [["a", "b"]], [[True, False]]]


@pytest.mark.parametrize(
    ("space", "n", "answer"), [*((CLASSES, 2, one) for one in NO_CLASSES), *((TWO_NUMBERS, 1, one) for one in NO_ROW)]
)
def test_other_answers_are_not_executed(space, n, answer):
    assert space.executed(np.asarray(answer), n) is None


def test_a_box_clips_and_takes_the_precision_of_its_bounds_and_has_no_draw_without_them():
    box = Box(np.float32([-1, 0]), np.float32([1, 10]))
    actions = box.executed(np.array([[-3.0, 4.0], [0.25, 1e300]]), 2)
    assert actions.dtype == np.float32
    np.testing.assert_array_equal(actions, [[-1, 4], [0.25, 10]])
    np.testing.assert_array_equal(box.executed(np.array([[3, 4]]), 1), [[1, 4]])
    assert box.executed(np.empty((0, 2)), 0).shape == (0, 2)
    assert str(box) == "continuous actions (-1 to 1, 0 to 10)"
    with pytest.raises(DataError, match=r"from continuous actions \(-1 to inf\): give .* two finite bounds\.$"):
        Box(np.float32([-1]), np.float32([np.inf])).draw(3, np.random.default_rng(0))


def test_flip_and_shift_stay_in_the_box_and_undo_themselves():
    box = Box(np.float32([-0.1, 3]), np.float32([0.3, 1000]))
    actions = box.draw(5000, np.random.default_rng(1))
    for turn in (box.flip, box.shift):
        turned = turn(actions)
        assert turned.dtype == np.float32
        assert ((box.low <= turned) & (turned <= box.high)).all()
        # A number at half of its range may come back at either end.
        inside = np.abs(actions - (box.low + box.high) / 2) > 1e-3 * (box.high - box.low)
        np.testing.assert_allclose(np.where(inside, turn(turned), actions), actions, rtol=1e-4, atol=1e-6)


X, OFFSETS = np.zeros((4, 1)), [0, 1, 4]
MOVES = Demonstrations(X, np.array([[0.0], [2.0], [1.0], [-1.0]]), OFFSETS, ids=["a", "b"])


def test_continuous_actions_have_a_box():
    space, classes = action_space(MOVES)
    assert (space.low.tolist(), space.high.tolist(), len(classes)) == ([-1], [2], 0)
    np.testing.assert_array_equal(encode_actions(classes, MOVES.actions, "a.csv"), MOVES.actions)
    assert action_space(MOVES, (-5, 5))[0].high.tolist() == [5]
    with pytest.raises(DataError, match="demonstration 'b': action 0 is 2, outside the declared box from -1 to 1"):
        action_space(MOVES, (-1, 1))


def test_actions_too_small_to_be_squared_are_refused():
    """One part alone is enough, and an offset does not help; a part that never changes is no such one."""
    still = np.zeros((4, 1))
    for size in (1e-300, 1e-155):
        actions = np.concatenate([still, MOVES.actions * size], axis=1)
        with pytest.raises(DataError, match=r"action 1 varies by less than 1e-150.*use smaller units"):
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
