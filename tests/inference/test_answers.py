"""Answers, counted, divided, shared by copies, and made rows of a regression, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from hand_made import answers_of
from rpil.data.errors import DataError
from rpil.inference.answers import Answers, check_copied_labels

NAN = np.nan


def test_what_is_known_is_counted():
    assert not Answers.none(0).count
    assert not answers_of([0, 0]).count
    some = answers_of([1, 0, -1, 0], [(0, 1)], [NAN, 2.0, 3.0, NAN])
    assert some.count == 4  # the outcome of one that is labelled is no answer more
    assert some.has_outcome.tolist() == [False, True, True, False]
    both = answers_of([0] * 3, outcome=[[NAN, 2.0, NAN], [1.0, 5.0, NAN]])
    assert both.count == 2, "nor is a second one"
    assert answers_of([1, 0, -1, 0], [(0, 1)], tied=[(0, 2), (1, 3)]).count == 5
    labelled = Answers.of_labels(np.array([1, 0, -1]))
    assert (labelled.count, labelled.pairs.shape, labelled.outcomes.shape) == (2, (0, 2), (3, 0))
    assert some.unsaid.count == 2
    np.testing.assert_array_equal(some.unsaid.outcomes, some.outcomes)


def test_answers_about_some_of_the_demonstrations():
    ends = [[NAN, 2.0, 3.0, 4.0], [1.0, NAN, 0.0, 1.0]]
    some = answers_of([1, 0, -1, 0], [(0, 1), (3, 2), (2, 0)], ends, tied=[(0, 3), (1, 3)]).select([2, 0, 3])
    assert some.labels.tolist() == [-1, 1, 0]
    assert (some.pairs.tolist(), some.tied.tolist()) == ([[2, 0], [0, 1]], [[1, 2]])
    np.testing.assert_array_equal(some.outcomes, [[3.0, 0.0], [NAN, 1.0], [4.0, 1.0]])
    assert some.names == ("outcome", "other")
    assert answers_of([1, 0], [(0, 1)]).select([1]).pairs.shape == (0, 2)
    marked = replace(answers_of([0] * 4), marks=np.array([[1, 0, 5, 1], [2, 3, 4, -1]]))
    assert marked.select([2, 0]).marks.tolist() == [[0, 3, 4, -1]]


@pytest.mark.parametrize(
    ("answers", "sides", "contrast"),
    [
        (answers_of(m=3), set(), False), (answers_of([1, 0, 1]), {1}, False), (answers_of([1, -1]), {1, -1}, True),
        (answers_of(m=2, outcome=[0.0, 0.0]), {-1}, False), (answers_of([1, 0], outcome=[NAN, 0.0]), {1, -1}, True),
        (answers_of([1, 0], outcome=[0.0, NAN]), {1}, False),  # a label goes first
        (answers_of(m=3, outcome=[1.0, 2.0, 3.0]), {1, -1}, True),
        (answers_of(m=5, outcome=[0.0, 0.0, 0.0, 0.0, -1.0]), {1, -1}, True),  # most have no retry
        (answers_of(m=4, outcome=[[1, 1, 1, 0], [1, 0, 1, 1]]), {1, -1}, True),
        (answers_of(m=3, outcome=[[7, 7, 7], [NAN] * 3]), set(), False),
        (answers_of(m=2, pairs=[(0, 1)]), {1, -1}, False), (answers_of(m=3, pairs=[(0, 1), (1, 2)]), {1, -1}, True),
        (answers_of(m=2, tied=[(0, 1)]), set(), False), (answers_of([1, 1], tied=[(0, 1)]), {1}, False),
    ],
)  # fmt: skip
def test_answers_contrast_where_there_are_two_and_both_sides(answers, sides, contrast):
    assert (answers.sides, answers.contrast) == (sides, contrast)


def test_a_flag_of_zero_is_said_of_its_demonstration_and_of_copies_without_one():
    known, likely = answers_of([0, 0, 0, 1], outcome=[0.0, 1.0, NAN, 0.0]), np.full(4, 3.0)
    assert known.failed(likely).tolist() == [True, False, False, True]
    assert known.said(likely).tolist() == [-1, 0, 0, 1]
    assert known.shared(np.array([0, 1, 0, 3])).said(likely).tolist() == [-1, 0, -1, 1]
    numbers = answers_of([0] * 3, outcome=[0.0, 1.0, 2.0])
    assert numbers.said(np.zeros(3)).tolist() == [0] * 3, "no flag"
    assert numbers.select([0, 1]).said(np.zeros(2)).tolist() == [0] * 2, "nor are some of them"
    assert answers_of(m=2, outcome=[[0.0, 1.0]] * 2).said(np.zeros(2)).tolist() == [0, 0], "nor is one of several"
    assert answers_of([-1, 0]).said(np.zeros(2)).tolist() == [-1, 0]


def test_once_others_speak_a_flag_is_obeyed_where_good_is_unlikely_and_none_with_a_0_is_called_good():
    outcome, log_odds = [0.0, 0.0, 0.0, 1.0, NAN], np.array([-1.0, 0.0, 0.1, -1.0, -1.0])
    two, both = answers_of([0, 0, 0, 1, -1], outcome=outcome), answers_of(m=5, outcome=[outcome, [1, 2, 3, 4, 5]])
    speaks = [two, answers_of([-1, 0, 0, 1, 0], outcome=outcome)]
    speaks += [answers_of(m=5, outcome=outcome, pairs=[(0, 4), (0, 1)])]  # none better than one with a 1
    alone = [answers_of(m=5, outcome=outcome, **{kind: [(3, 4)]}) for kind in ("pairs", "tied")]  # no contrast
    cases = [(one, heard, n) for n, some in ((2, speaks), (3, alone)) for one in some for heard in (None, (1,), (0,))]
    denied = [answers_of([1, 0, 0, 0, -1], outcome=outcome), answers_of(m=5, pairs=[(0, 3), (0, 1)], outcome=outcome)]
    cases += [(one, heard, n) for one in denied for heard, n in (((1,), 2), ((0,), 0))]
    cases += [(both, (1, 0), 3), (both, (0, 1), 2), (both, (1, -1), 2), (both, (-1, 1), 0)]
    for known, heard, n in cases:
        assert replace(known, heard=heard).failed(log_odds).tolist() == [m < n for m in range(5)], (known, heard)


@pytest.mark.parametrize(
    ("names", "failure"), [(("success",), "success = 0"), (("-retries",), "retries = 1"), ((), "outcome = 0")]
)
def test_a_failure_is_named_by_its_column(names, failure):
    assert replace(answers_of(m=2), names=names).failure == failure


def test_rows_are_all_demonstrations_then_differences_of_pairs_and_ties_both_ways():
    columns = np.array([[1.0, 2.0], [3.0, 5.0], [7.0, 11.0], [13.0, 17.0]])
    some = answers_of([0, -1, 0, 1], [(0, 2), (3, 1)], tied=[(1, 0)])
    rows, n_pairs = some.rows(columns)
    assert rows[:4].tolist() == [[1, 1, 2], [1, 3, 5], [1, 7, 11], [1, 13, 17]]
    assert rows[4:].tolist() == [[0, -6, -9], [0, 10, 12], [0, 2, 3], [0, -2, -3]]
    assert (n_pairs, some.evidence(3.0).tolist()) == (4, [0, -3, 0, 3, 3, 3, 3, 3])


def test_outcomes_that_count_for_nothing_are_no_side_and_a_turned_flag_is_not_obeyed():
    flags, likely = answers_of(m=4, outcome=[1.0, 0.0, 1.0, 0.0]), np.full(4, 3.0)
    for heard, contrast, obeyed in ((None, True, True), ((0,), False, True), ((-1,), True, False)):
        one = replace(flags, heard=heard)
        assert (one.contrast, one.failed(likely).tolist()) == (contrast, [False, obeyed, False, obeyed])


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
