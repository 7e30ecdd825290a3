"""Answers about copies of demonstrations: contradictions, shared labels and outcomes."""

from __future__ import annotations

import numpy as np
import pytest

from hand_made import answers_of
from rpil.data.errors import DataError
from rpil.inference.answers import Answers, check_copied_labels

NAN = np.nan


def test_copies_with_labels_that_contradict_each_other_are_refused_in_one_sentence():
    copy_of, ids = np.array([0, 1, 0, 1]), ["a", "b", "c", "d"]
    check_copied_labels(Answers.of_labels(np.array([1, -1, 1, 0])), copy_of, ids)
    with pytest.raises(DataError) as error:
        check_copied_labels(Answers.of_labels(np.array([1, -1, 0, 1])), copy_of, ids, "f.csv")
    assert str(error.value) == "f.csv: 'd' is labelled good and 'b', a copy of it, bad; change one of the labels."


def test_copies_share_a_label_and_the_mean_of_outcomes_which_is_a_flag_where_each_is():
    known = answers_of([0, 0, 1, 0], outcome=[[NAN, 1.0, NAN, 2.0], [3.0, NAN, NAN, NAN]])
    shared = known.shared(np.array([0, 1, 0, 1]))
    assert shared.labels.tolist() == [1, 0, 1, 0]
    np.testing.assert_array_equal(shared.outcomes.T, [[NAN, 1.0, NAN, 2.0], [3.0, NAN, 3.0, NAN]])
    of_three = known.shared(np.array([1, 1, 2, 1]))
    assert of_three.outcomes[0, 0] == 1.5, "the mean of its copies where its own is unknown"
    copy_of = np.array([0, 1, 2, 3, 0])
    for last, mean in ((1, 1), (0, 0.5)):
        once = answers_of(m=5, outcome=[1, 0, 0, 1, last]).once(copy_of)
        assert (once.outcomes.tolist(), once.only_flag) == ([[mean], [0], [0], [1]], 0)
    once = answers_of(m=4, outcome=[0, 2, 0, 0]).once(np.array([0, 0, 2, 3]))
    assert (once.outcomes.tolist(), once.only_flag) == ([[1], [0], [0]], -1)
