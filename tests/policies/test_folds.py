"""Folds of demonstrations, and predictions out of them."""

from __future__ import annotations

import numpy as np

from problems import fit_data_of, make, make_continuous
from rpil.policies.folds import deal, out_of_fold, pieces


def test_fold_of_a_demonstration_does_not_depend_on_the_order():
    for problem in (fit_data_of(make("noisy", 1, steps=(30, 30))), fit_data_of(make_continuous("noisy", 1))):
        order = np.random.default_rng(0).permutation(problem.n_demonstrations)
        np.testing.assert_array_equal(deal(problem, 5, 0)[order], deal(problem.select(order), 5, 0))


def test_folds_have_equally_many_demonstrations_or_one_more():
    problem = fit_data_of(make("noisy", 1))
    m = problem.n_demonstrations
    for n_folds in (2, 3, m):
        assert set(np.bincount(deal(problem, n_folds, 0))) <= {m // n_folds, -(-m // n_folds)}
    assert (deal(problem, m, 0) != deal(problem, m, 1)).any()


def test_pieces_have_all_steps_and_no_labels():
    problem = fit_data_of(make("noisy", 1))
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
