"""Facts about demonstrations: what a column says of how each ended, and what a user gives."""

import numpy as np
import pytest

from problems import refused
from rpil.data.fit_data import check_outcome, check_sessions, given_outcome, outcome_of_steps

OFFSETS, NAN = np.array([0, 3, 5, 9]), np.nan


def of_steps(values, column):
    return outcome_of_steps(np.array(values, dtype=float), OFFSETS, column)


@pytest.mark.parametrize(
    ("values", "column", "expected"),
    [
        ([1, 2, 3, 4, 5, 6, 7, 8, 9], "reward", [6, 9, 30]), ([1, 2, 3, 4, 5, 6, 7, 8, 9], "next.reward", [6, 9, 30]),
        ([1, 1, 1, 2, 2, 3, 3, 3, 3], "rewards", [3, 4, 12]),  # constant rewards are added up, too
        ([1, NAN, 3, 4, 5, 6, 7, 8, 9], "rewards", [NAN, 9, 30]),
        ([0, 0, 1, 0, 0, 1, 1, 1, 0], "next.success", [1, 0, 0]),
        ([0, 0, 1, NAN, NAN, 1, 0, 1, NAN], "success", [1, NAN, 1]),
        ([1, NAN, NAN, 0, 1, 0, 0, 1, 0], "success", [1, 1, 0]), ([7] * 3 + [NAN] * 2 + [5] * 4, "score", [7, NAN, 5]),
        ([7, 7, 7, -2, -2, 5, NAN, 5, 5], "episode_return", [7, -2, 5]),
    ],
)  # fmt: skip
def test_outcome_of_steps(values, column, expected):
    np.testing.assert_array_equal(of_steps(values, column), expected)


def test_a_column_that_changes_and_is_neither_reward_nor_flag_is_no_outcome():
    assert of_steps([0, 1, 2, 0, 1, 0, 1, 2, 3], "score") is None


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([1.0, 1.0, 1.0], "is 1 for every"), ([1.0, NAN, 1.0], "is 1 for every"),
        ([NAN, NAN, NAN], "known for no demonstration"), ([1.0, np.inf, 0.0], "infinite"),
    ],
)  # fmt: skip
def test_an_outcome_that_tells_nothing_is_refused(given, words):
    with refused(rf"a\.csv.*{words}"):
        check_outcome(np.array(given), "the outcome 'success'", "a.csv")


def test_outcomes_by_id_leave_others_unknown(tmp_path):
    (tmp_path / "out.csv").write_text("id,value\na,1\nb,\nc,True\nd,0.5\n")
    np.testing.assert_array_equal(given_outcome(str(tmp_path / "out.csv"), "abd", "x", "abcd"), [1, NAN, 0.5])
    for cells, words in (("b,0\nb,1\n", "it has two outcomes"), ("b,yes\nc,0\n", "the outcome 'yes' is no number")):
        (tmp_path / "out.csv").write_text(f"id,value\na,1\n{cells}")
        with refused(rf"out\.csv, demonstration 'b': {words}"):
            given_outcome(str(tmp_path / "out.csv"), "abc", "x")
    np.testing.assert_array_equal(given_outcome({7: 1, "8": 0.5}, [8, 7, 9], "a"), [0.5, 1, NAN])
    np.testing.assert_array_equal(given_outcome([1, 2, 3], "abc", "a"), [1, 2, 3])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"d": 1.0}, "demonstration is called 'd'"), ([1, 2], r"e \(2,\)"), ([1, None, "x"], "'c': the outcome 'x' is"),
        ([1, 10**400, 0], "'b': the outcome 10{39} is"),
    ],
)  # fmt: skip
def test_wrong_outcomes_are_refused(given, words):
    with refused(words):
        given_outcome(given, "abc", "a.csv")


@pytest.mark.parametrize(("sessions", "name"), [("abc", "day"), ("abc", "file"), ("aaa", "file")])
def test_sessions_that_divide_nothing_are_refused(sessions, name):
    with refused("makes no sessions"):
        check_sessions(tuple(sessions), name, "a.csv")
