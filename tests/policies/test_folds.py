"""Folds of demonstrations, and predictions out of them."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from problems import make, make_continuous
from rpil.policies.folds import deal, out_of_fold, pieces


def test_fold_of_a_demonstration_does_not_depend_on_names_of_actions():
    problem = make("noisy", 1, steps=(30, 30)).problem()
    for renamed in permutations(range(3)):
        other = replace(problem, actions=np.array(renamed)[problem.actions])
        np.testing.assert_array_equal(deal(other, 5, 0), deal(problem, 5, 0))


@pytest.mark.parametrize("maker", [make, make_continuous])
def test_fold_of_a_demonstration_does_not_depend_on_copies_units_or_order_of_columns(maker):
    problem = maker("noisy", 1, steps=(30, 30)).problem()
    problem = replace(problem, actions=np.zeros_like(problem.actions))  # so that only observations tell them apart
    columns, fold = problem.features, deal(problem, 5, 0)
    for features in (
        columns[:, [0, 0, *range(columns.shape[1])]],
        columns[:, ::-1],
        columns * np.geomspace(1e-9, 1e9, columns.shape[1]) + 3.0,
        np.column_stack([np.full(len(columns), 0.1), columns]),  # never changes
    ):
        np.testing.assert_array_equal(deal(replace(problem, features=features), 5, 0), fold)


def test_same_steps_in_another_order_are_another_demonstration():
    problem = make("noisy", 1, n_good=1, n_bad=0, steps=(30, 30)).problem()
    steps = np.concatenate([np.random.default_rng(m).permutation(30) for m in range(12)])
    own = {"features": problem.features[steps], "actions": problem.actions[steps]}
    shuffled = replace(problem, **own, offsets=np.arange(13) * 30, labels=np.zeros(12, dtype=int))
    order = np.random.default_rng(0).permutation(12)
    np.testing.assert_array_equal(deal(shuffled, 5, 0)[order], deal(shuffled.select(order), 5, 0))


def test_folds_have_equally_many_demonstrations_or_one_more():
    problem = make("noisy", 1).problem()
    m = problem.n_demonstrations
    for n_folds in (2, 3, m):
        assert set(np.bincount(deal(problem, n_folds, 0))) <= {m // n_folds, -(-m // n_folds)}
    assert (deal(problem, m, 0) != deal(problem, m, 1)).any()


def test_pieces_have_all_steps_and_no_labels():
    problem = make("noisy", 1).problem()
    cut = pieces(problem, 20)
    assert cut.n_demonstrations == 20
    assert np.ptp(cut.lengths) <= 1
    assert not cut.labels.any()
    assert cut.offsets[-1] == len(problem.actions)
    assert pieces(problem.select(np.array([0])), 10**6).lengths.max() == 1


def test_predictions_of_a_fold_do_not_use_it():
    fold, values = np.array([0, 2, 1, 0, 2]), np.array([1.0, 10.0, 100.0, 1000.0, 10000.0])
    found = out_of_fold(fold, lambda k, test: np.full((test.sum(), 2), values[~test].sum() + k))
    expected = [values[fold != k].sum() + k for k in fold]
    np.testing.assert_array_equal(found, np.column_stack([expected, expected]))


def with_copies(problem, numbers):
    """The problem with the demonstrations `numbers` once more at the end, in an order of its own."""
    every = np.concatenate([np.arange(problem.n_demonstrations), numbers])
    order = np.random.default_rng(3).permutation(len(every))
    return problem.select(every[order]), every[order]


@pytest.mark.parametrize(
    ("maker", "numbers"), [(make, [0] * 9), (make_continuous, [*range(20)]), (make, [1, 1, 4, 4, 4, 7])]
)
def test_copies_of_a_demonstration_are_in_its_fold_and_folds_stay_balanced(maker, numbers):
    problem = maker("noisy", 1, n_good=12, n_bad=8).problem()
    data, originals = with_copies(problem, numbers)
    largest = np.bincount(originals).max()
    for n_folds in (2, 5, data.n_demonstrations):
        fold = deal(data, n_folds, 0)
        for m in set(originals):
            assert len(set(fold[originals == m])) == 1
        sizes = np.bincount(fold)
        assert sizes.min() > 0
        assert len(sizes) == min(n_folds, len(set(originals)))
        if n_folds < 20:
            assert sizes.max() <= max(largest, -(-len(originals) // n_folds) + largest - 1)
            rest = np.delete(sizes, np.argmax(sizes))
            assert np.ptp(rest) <= largest
        order = np.random.default_rng(4).permutation(len(originals))
        np.testing.assert_array_equal(fold[order], deal(data.select(order), n_folds, 0))


def test_a_demonstration_with_one_other_step_is_no_copy_and_nothing_but_copies_is_dealt_into_all_folds():
    problem = make("noisy", 1, n_good=12, n_bad=8, steps=(30, 30)).problem()
    data, originals = with_copies(problem, [*range(20)])
    features = data.features.copy()
    features[data.offsets[:-1], 0] += 1e-9 * np.arange(40)  # too small a change for the order, which is rounded
    folds = deal(replace(data, features=features), 5, 0)
    assert any(len(set(folds[originals == m])) == 2 for m in range(20))
    np.testing.assert_array_equal(np.bincount(deal(problem.select(np.zeros(10, dtype=int)), 5, 0)), [2] * 5)
