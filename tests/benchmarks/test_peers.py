"""Every contestant on a case where it is known to work, so that none loses through a bug of ours."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from sklearn.linear_model import LogisticRegression, Ridge
from sklearn.metrics import roc_auc_score

from contestants import CONTESTANTS
from contestants.ileed import ileed_loss, ileed_shapes
from problems import make, make_continuous

RANDOM = make("random", 0, n_good=10, n_bad=4, steps=(40, 60), sharpness=10.0)
CONTINUOUS = make_continuous("random", 0, n_good=10, n_bad=4, steps=(40, 60))


@cache
def scores(name, toy):
    """Computed once for all tests."""
    return CONTESTANTS[name](toy.demonstrations, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(CONTESTANTS) - {"length"}))
def test_random_demonstrations_are_last(name):
    assert scores(name, RANDOM).shape == (14,)
    least = 0.8 if name == "short judge" else 1.0  # it does not rank all random ones last
    assert roc_auc_score(RANDOM.is_good, scores(name, RANDOM)) >= least
    np.testing.assert_array_equal(CONTESTANTS[name](RANDOM.demonstrations, 0), scores(name, RANDOM))


@pytest.mark.parametrize("toy", [RANDOM, CONTINUOUS], ids=["discrete", "continuous"])
def test_held_out_likelihoods_agree_with_scikit_learn(toy):
    data = toy.demonstrations
    folds = np.random.default_rng(0).permutation(14) % 5
    X, y, group = data.observations, data.actions, data.groups
    expected, error = np.empty(len(y)), np.empty(y.shape)
    for fold in range(5):
        asked = (folds == fold)[group]
        if y.ndim == 1:
            policy = LogisticRegression(C=100, max_iter=1000).fit(X[~asked], y[~asked])
            expected[asked] = policy.predict_log_proba(X[asked])[np.arange(asked.sum()), y[asked]]
        else:
            error[asked] = y[asked] - Ridge(1.0).fit(X[~asked], y[~asked]).predict(X[asked])
    if y.ndim == 2:  # Student's density with four degrees of freedom, up to a constant
        expected = -2.5 * np.log1p((error / (np.median(np.abs(error), axis=0) / 0.741)) ** 2 / 4).sum(axis=1)
    else:
        expected = np.maximum(expected, np.log(1e-3))
    expected = np.bincount(group, expected) / np.bincount(group)
    assert np.corrcoef(scores("likelihood", toy), expected)[0, 1] > 0.99


def test_ileeds_gradient():
    problem = make("noisy", 0, n_good=2, n_bad=2, steps=(5, 8), n_actions=4).problem()
    ridge = np.array([0.3, 0.2, 0.0])
    shapes = ileed_shapes(problem)
    assert shapes == [(3, 4), (3, 2), (4, 2)]
    point = np.random.default_rng(0).normal(size=sum(np.prod(shape) for shape in shapes))
    _, gradient = ileed_loss(point, problem, ridge)
    numeric = approx_fprime(point, lambda x: ileed_loss(x, problem, ridge)[0], 1e-7)
    np.testing.assert_allclose(gradient, numeric, rtol=1e-4, atol=1e-4)
