"""An adversary with a policy of its own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from problems import make_continuous, ridge
from rpil.data.fit_data import FitData
from rpil.mixture.adversaries.own import OwnPolicy
from rpil.policies.linear import linear_policy


def fresh(problem: FitData) -> OwnPolicy:
    """An adversary that has seen no data."""
    return OwnPolicy(linear_policy(problem.space, ridge(problem), len(problem.actions)))


def test_an_own_policy_has_a_density_over_all_numbers():
    """Student's."""
    problem = make_continuous("noisy", 1, n_parts=1).problem()
    found, weight = fresh(problem), np.random.default_rng(0).random(len(problem.actions))
    for _ in range(3):
        found = found.fit(problem, problem.actions, weight)

    def density(a: float) -> float:
        return float(np.exp(found.log_prob(problem.features[:1], np.zeros((1, 1)), np.array([[a]]))[0]))

    mean = found.policy.outputs(problem.features[:1])[0, 0]
    total = quad(density, -np.inf, mean)[0] + quad(density, mean, np.inf)[0]
    assert total == pytest.approx(1.0, abs=1e-5)


def test_own_policy_recovers_the_true_policy():
    toy = make_continuous("none", 5, n_good=30, n_bad=0, steps=(100, 100))
    problem = toy.problem()
    found = fresh(problem)
    for _ in range(10):
        found = found.fit(problem, toy.actions, np.ones(len(toy.actions)))
    truth = toy.observations @ toy.weights[:-1] + toy.weights[-1]
    assert np.abs(found.policy.outputs(problem.features) - truth).mean() < 0.03
