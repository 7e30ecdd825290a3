"""Labels are asked for in the middle of the ranking, where they settle the most pairs."""

from __future__ import annotations

import numpy as np

from rpil.audit.label_choice import NEXT_STEPS, choose_labels, middle_first
from rpil.inference.findings import FINDINGS


def test_every_finding_has_a_next_step_of_one_sentence():
    assert NEXT_STEPS.keys() == FINDINGS.keys()
    assert all(sentence.endswith(".") and sentence.count(". ") == 0 for sentence in NEXT_STEPS.values())


def test_middle_of_the_ranking_has_the_most_pairs_in_the_wrong_order():
    """Counted over random truths in which the demonstration of rank r is an expert's with probability r."""
    size, draws = 11, 20_000
    rank = (np.arange(size) + 0.5) / size
    good = np.random.default_rng(0).random((draws, size)) < rank
    bad_above = (~good)[:, ::-1].cumsum(axis=1)[:, ::-1] - ~good
    good_below = good.cumsum(axis=1) - good
    wrong = np.where(good, bad_above, good_below).mean(axis=0)
    np.testing.assert_array_equal(middle_first(np.arange(11.0)), np.argsort(-(wrong + wrong[::-1]), kind="stable"))
    np.testing.assert_allclose(wrong, (size / 2 - 1) * rank * (1 - rank), atol=0.03)


def test_middle_first_follows_the_ranking_and_not_the_order_of_the_data():
    size = 21
    shuffled = np.random.default_rng(1).permutation(size)
    log_odds = np.empty(size)
    log_odds[shuffled] = np.sort(np.random.default_rng(2).normal(size=size) ** 3)
    indices = middle_first(log_odds)
    assert indices[0] == shuffled[10]
    assert set(indices[:5]) == set(shuffled[8:13])
    assert set(indices[-2:]) == {shuffled[0], shuffled[-1]}


def test_only_the_order_of_the_log_odds_matters():
    log_odds = np.random.default_rng(0).normal(size=12)
    assert choose_labels(log_odds, [], [], 4) == choose_labels(np.exp(log_odds) + 5.0, [], [], 4)


def test_competing_groups_come_first_and_labelled_demonstrations_never():
    log_odds = np.array([-9.0, -8.0, 0.0, 1.0, 7.0, 8.0, 9.0])
    assert choose_labels(log_odds, [], [], 1) == [3]
    assert choose_labels(log_odds, [6, 0], [], 1) == [6]
    assert choose_labels(log_odds, [6, 0], [], 3) == [6, 0, 3]
    assert choose_labels(log_odds, [6, 0], [6, 3], 2) == [0, 2]
    assert choose_labels(log_odds, [], [3, 4, 5, 6], 1) == [1]  # the middle of the three without a label
    assert sorted(choose_labels(log_odds, [6], [3], 60)) == [0, 1, 2, 4, 5, 6]
