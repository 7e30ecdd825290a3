"""What demonstrators add to answers: columns that count as far as answers bear them out."""

from __future__ import annotations

import numpy as np

from hand_made import answers_of
from rpil.data.fit_data import Demonstrators
from rpil.inference.answered import MOST_INDICATORS, answer, with_demonstrators
from rpil.inference.settings import AnswerSettings

SETTINGS = AnswerSettings()


def test_the_columns_of_demonstrators_by_hand():
    """Of 0, 0, 1, 2, 2, 2, of whom demonstrator 2 has two answers, a label and a pair."""
    columns, index = np.column_stack([[1.0, 2, 3, 4, 5, 9], np.arange(6), -np.arange(6)]), np.array([0, 0, 1, 2, 2, 2])
    found = with_demonstrators(columns, answers_of([1, 0, 0, 0, 0, -1], pairs=[(2, 3)], m=6), index, 2.0)
    np.testing.assert_array_equal(found[:, [0, 1, 4]], columns)
    np.testing.assert_array_equal(found[:, 2], 2 * (np.array([2, 1, 4, 7, 6.5, 4.5]) - 4) * (index != 1))
    np.testing.assert_array_equal(found[:, 3], 2 * (index == 2))
    once = with_demonstrators(columns, answers_of([1, 0, 0, 0, 0, -1], m=6), index, 2.0)
    np.testing.assert_array_equal(once, found[:, [0, 1, 2, 4]])
    many = np.repeat(np.arange(40), [2] * 39 + [3])
    found = with_demonstrators(np.zeros((81, 2)), answers_of([1] * 81, m=81), many, 1.0)[:, 2:-1]
    np.testing.assert_array_equal(found, many[:, None] == [*range(MOST_INDICATORS - 1), 39])


def test_of_copies_the_first_with_a_name_says_whose_they_are():
    columns, labels = np.random.default_rng(0).normal(size=(9, 3)), [1, -1, 1, -1, 1, -1, 0, 0, 0]
    copy_of = np.array([0, 1, 2, 3, 4, 5, 6, 0, 1])
    names = [[None, None, "a", "b", "b", "a", "b", "a", "b"], ["a", "b", "a", "b", "b", "a", "b", "b", None]]
    found = [
        answer(columns[copy_of], answers_of(labels, m=9), SETTINGS, copy_of, Demonstrators.from_names(one)).log_odds
        for one in names
    ]
    np.testing.assert_array_equal(*found)


def of_operators(index, bad, ranking, seed=0):
    """AUROC of 200 demonstrations after sixteen labels: with demonstrators, and without."""
    chosen = np.random.default_rng(seed).choice(200, 16, replace=False)
    labels = np.zeros(200, dtype=int)
    labels[chosen] = np.where(bad[chosen], -1, 1)
    columns = np.column_stack([ranking, np.zeros(200)])
    who = Demonstrators.from_names(index.tolist()), Demonstrators()
    found = [answer(columns, answers_of(labels, m=200), SETTINGS, np.arange(200), one).log_odds for one in who]
    return [np.mean(one[~bad][:, None] > one[bad]) for one in found]


def test_demonstrators_tell_where_quality_is_theirs_and_harm_no_order_where_it_is_not():
    """Their styles move the ranking by as much as bad demonstrations do."""
    gains, changes = [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        index, noise = rng.integers(8, size=200), rng.normal(size=200)
        of_two, by_chance, style = index < 2, rng.random(200) < 0.25, rng.normal(size=8)
        gains.append(np.subtract(*of_operators(index, of_two, noise - of_two, seed)))
        changes.append(np.subtract(*of_operators(index, by_chance, noise - by_chance + style[index], seed)))
    assert np.mean(gains) > 0.1
    assert np.mean(changes) > -0.02
