"""Answers about copies of demonstrations: contradictions, shared labels and outcomes."""

from __future__ import annotations

import numpy as np
import pytest

from hand_made import answers_of
from rpil.data.errors import DataError
from rpil.inference.answers import Answers, check_copied_labels


def test_copies_with_labels_that_contradict_each_other_are_refused_in_one_sentence():
    copy_of, ids = np.array([0, 1, 0, 1]), ["a", "b", "c", "d"]
    check_copied_labels(Answers.of_labels(np.array([1, -1, 1, 0])), copy_of, ids)
    with pytest.raises(DataError) as error:
        check_copied_labels(Answers.of_labels(np.array([1, -1, 0, 1])), copy_of, ids, "f.csv")
    assert str(error.value) == "f.csv: 'd' is labelled good and 'b', a copy of it, bad; change one of the labels."


def test_copies_share_a_label_and_an_outcome():
    known = Answers(np.array([0, 0, 1, 0]), np.empty((0, 2), dtype=int), np.array([np.nan, 1.0, np.nan, 2.0]))
    shared = known.shared(np.array([0, 1, 0, 1]))
    assert shared.labels.tolist() == [1, 0, 1, 0]
    np.testing.assert_array_equal(shared.outcome, [np.nan, 1.0, np.nan, 2.0])
    of_three = known.shared(np.array([1, 1, 2, 1]))
    assert of_three.outcome[0] == 1.5, "the mean of its copies where its own is unknown"


def test_flags_of_copies_that_contradict_each_other_change_no_other_row():
    copy_of = np.array([0, 1, 2, 3, 0])
    one, other = (answers_of(m=5, outcome=[1, 0, 0, 1, last]).once(copy_of) for last in (1, 0))
    np.testing.assert_array_equal(one.ranks(), [1, 0, 0, 1])
    np.testing.assert_array_equal(other.ranks(), [0.5, 0, 0, 1])
    np.testing.assert_array_equal(other.only(np.arange(4) > 0).ranks()[1:], other.ranks()[1:])


def test_returns_of_copies_are_no_flag_where_their_means_are_0_and_1():
    np.testing.assert_array_equal(
        answers_of(m=4, outcome=[0, 2, 0, 0]).once(np.array([0, 0, 2, 3])).ranks(), np.array([5, 2, 2]) / 6
    )
