"""An adversary with a policy of its own."""

from __future__ import annotations

import numpy as np

from problems import make_continuous, ridge
from rpil.data.fit_data import FitData
from rpil.mixture.adversaries.named import OwnPolicy
from rpil.policies.linear import linear_policy


def fresh(problem: FitData) -> OwnPolicy:
    """An adversary that has seen no data."""
    return OwnPolicy(linear_policy(problem.space, ridge(problem), len(problem.actions)))


def test_own_policy_recovers_the_true_policy():
    toy = make_continuous("none", 5, n_good=30, n_bad=0, steps=(100, 100))
    problem = toy.problem()
    found = fresh(problem)
    for _ in range(10):
        found = found.fit(problem, toy.actions, np.ones(len(toy.actions)))
    truth = toy.observations @ toy.weights[:-1] + toy.weights[-1]
    assert np.abs(found.policy.outputs(problem.features) - truth).mean() < 0.03
