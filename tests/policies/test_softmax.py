"""The softmax policy."""

import numpy as np
from scipy.special import log_softmax

from problems import make, ridge
from rpil.numerics.blocks import at_actions, one_hot
from rpil.policies.softmax import SoftmaxPolicy

PROBLEM = make("noisy", 0).problem()
WEIGHT = np.random.default_rng(1).random(len(PROBLEM.actions))


def objective(weights, penalty):
    """The penalised log-likelihood, from its definition."""
    taken = log_softmax(PROBLEM.features @ weights, axis=1)[np.arange(len(WEIGHT)), PROBLEM.actions]
    return WEIGHT @ taken - 0.5 * (penalty[:, None] * weights**2).sum()


def test_targets_and_log_probabilities_of_the_actions_taken_and_of_the_zero_policy():
    policy = SoftmaxPolicy.zero(4, np.ones(3))
    np.testing.assert_allclose(np.exp(policy.outputs(np.random.default_rng(0).normal(size=(5, 3)))), 0.25)
    assert policy.penalty() == 0
    actions = np.array([2, 0])
    np.testing.assert_array_equal(one_hot(actions, np.array([0.5, 2.0]), 3), [[0, 0, 0.5], [2, 0, 0]])
    np.testing.assert_array_equal(at_actions(np.arange(6.0).reshape(2, 3), actions), [2, 3])


def test_a_fit_is_a_maximum_of_the_penalised_log_likelihood():
    penalty = ridge(PROBLEM)
    policy, log_proba = SoftmaxPolicy.zero(PROBLEM.space.n, penalty).fit(PROBLEM, WEIGHT, tol=1e-10)
    np.testing.assert_allclose(log_proba, policy.outputs(PROBLEM.features), atol=1e-9)
    best, rng = objective(policy.weights, penalty), np.random.default_rng(0)
    for _ in range(10):
        assert objective(policy.weights + 1e-2 * rng.normal(size=policy.weights.shape), penalty) < best


def test_statistics_are_the_gradient():
    rng, penalty = np.random.default_rng(0), ridge(PROBLEM)
    policy = SoftmaxPolicy(rng.normal(size=(PROBLEM.features.shape[1], PROBLEM.space.n)), penalty)
    taken, statistics = policy.collect_suff_stats(PROBLEM.features, PROBLEM.actions, WEIGHT)
    np.testing.assert_allclose(WEIGHT @ taken - policy.penalty(), objective(policy.weights, penalty))
    _, hessian = policy.with_preconditioner(PROBLEM, WEIGHT, penalty, 1.0)
    near, _ = policy.m_step(statistics, 1e-2, hessian, np.empty((0, 2, *policy.weights.shape)))
    gained = objective(near.weights, penalty) - objective(policy.weights, penalty)
    assert (np.abs(near.weights - policy.weights).max() <= 1e-2) & (gained > 0)
    direction = rng.normal(size=policy.weights.shape)
    direction -= direction.mean(axis=1, keepdims=True)  # what all actions share changes no probability
    up, down = (objective(policy.weights + h * direction, penalty) for h in (1e-5, -1e-5))
    slope = (policy.penalised_gradient(statistics) * direction).sum()
    np.testing.assert_allclose(slope, (up - down) / 2e-5, rtol=1e-5)
