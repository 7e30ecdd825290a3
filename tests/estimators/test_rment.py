"""Robust maximum entropy: concentration steps, the best subset, and what a user can get wrong."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning

from problems import make, make_continuous, ridge
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rment import RMEnt, concentrate, fit_selected
from rpil.numerics.blocks import one_hot
from rpil.policies.features import ridge_of
from rpil.policies.linear import linear_policy
from rpil.policies.softmax import SoftmaxPolicy

TOY = make("random", 0)


@pytest.mark.parametrize("kind", ["flipped", "noisy", "continuous"])
@pytest.mark.parametrize("start", [[11], list(range(12))])
def test_concentration_lowers_the_objective_to_a_fixed_point(kind, start):
    toy = make_continuous("noisy", 2) if kind == "continuous" else make(kind, 2, n_actions=4)
    problem = toy.problem()
    policy = linear_policy(problem.space, ridge(problem), len(problem.actions) / 2)
    first = fit_selected(problem, policy, np.isin(np.arange(12), start), 1e-9)
    found = concentrate(problem, first, 6, 1e-9, 50)
    assert found.converged
    objectives = [concentrate(problem, first, 6, 1e-9, k).objective for k in range(1, 1 + found.n_fits)]
    assert (np.diff(objectives) <= (1e-7 if kind == "continuous" else 1e-12)).all()
    assert found.log_likelihood[found.selected].min() >= found.log_likelihood[~found.selected].max()
    assert found.selected.sum() == 6


@pytest.mark.parametrize(("kind", "seed", "n_good"), [("noisy", 0, 4), ("flipped", 0, 3), ("shifted", 0, 2)])
def test_search_finds_the_best_of_all_subsets(kind, seed, n_good):
    """Not those that come first, also where most are bad in one way and agree best."""
    toy = make(kind, seed, n_good=n_good, n_bad=8 - n_good, steps=(5, 15), sharpness=2.0)
    model = RMEnt(n_trusted=4, tol=1e-10).fit(toy.demonstrations)
    problem, lengths = toy.problem(), np.diff(toy.offsets)
    penalty = ridge_of(model.features_, None, 4 * lengths.mean(), toy.space)
    objectives = {}
    for subset in combinations(range(8), 4):
        weight = np.isin(np.arange(8), subset) / lengths
        design = model.features_.design(toy.observations)
        steps = problem.per_step(weight)
        targets = one_hot(problem.actions, steps, problem.space.n)
        zero = SoftmaxPolicy.zero(toy.space.n, penalty / lengths.mean())
        policy, log_proba = zero.fit(replace(problem, features=design), steps, tol=1e-10)
        objectives[subset] = (policy.penalty() - (targets * log_proba).sum()) / 4
    best = min(objectives, key=objectives.get)
    assert model.objective_ == pytest.approx(objectives[best], abs=1e-8)
    assert tuple(np.flatnonzero(model.weights_)) == best


def test_demonstrations_weigh_the_same_whatever_their_length():
    """Repeating all steps of one changes nothing when everybody is trusted."""
    observations, actions, groups = TOY.observations, TOY.actions, TOY.groups
    order = np.argsort(np.concatenate([groups, groups[groups == 7]]), kind="stable")
    twice = [np.concatenate([a, a[groups == 7]])[order] for a in (observations, actions, groups)]
    plain = RMEnt(n_trusted=12, tol=1e-10).fit(observations, actions, groups=groups)
    longer = RMEnt(n_trusted=12, tol=1e-10).fit(*twice[:2], groups=twice[2])
    np.testing.assert_allclose(longer.predict_proba(observations), plain.predict_proba(observations), atol=1e-6)
    both = (observations, actions), twice[:2]
    cloned = [BehavioralCloning().fit(*data).predict_proba(observations) for data in both]
    assert np.abs(cloned[0] - cloned[1]).max() > 1e-3


def test_share_is_rounded_up():
    for share, number in ((0.5, 6), (0.3, 4), (0.26, 4), (0.01, 1), (0.99, 12), (np.int64(5), 5), (12, 12)):
        assert RMEnt(n_trusted=share, n_starts=1).fit(TOY.demonstrations).weights_.sum() == number
    for n, half in ((3, 2), (5, 3), (7, 4)):
        few = TOY.demonstrations.select(range(n))
        assert RMEnt(n_starts=1).fit(few).weights_.sum() == half
    many = make("random", 0, n_good=15, n_bad=10, steps=(5, 5)).demonstrations
    assert 0.28 * 25 > 7  # rounding errors are not rounded up
    assert RMEnt(0.28, n_starts=1).fit(many).weights_.sum() == 7


def test_warning_without_convergence():
    toy = make("noisy", 1, n_good=40, n_bad=40, steps=(2, 5), sharpness=1.5)
    with pytest.warns(ConvergenceWarning, match="raise it"):
        RMEnt(n_trusted=40, n_starts=1, max_iter=1).fit(toy.demonstrations)
