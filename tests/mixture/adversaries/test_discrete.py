"""Every adversary is the distribution it claims to be, knows what was intended, and learns without ever losing."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import log_softmax

from problems import refused
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.mixture.adversaries.discrete import Complement, Confusion, Marginal, Uniform
from rpil.mixture.adversaries.named import ADVERSARIES, adversary
from rpil.policies.linear import linear_policy

N = 40


def steps(n_actions: int, seed: int = 0) -> tuple[NDArray, NDArray, NDArray]:
    """Features, a policy's log-probabilities and actions."""
    rng = np.random.default_rng(seed)
    features = np.column_stack([rng.normal(size=(N, 2)), np.ones(N)])
    log_policy = log_softmax(3 * rng.normal(size=(N, n_actions)), axis=1)
    return features, log_policy, rng.integers(n_actions, size=N)


def named(name: str, n_actions: int, ridge: tuple[float, ...] = (0.3, 0.3, 0.0)):
    """An adversary that has seen nothing."""
    space = Discrete(n_actions)
    return adversary(name, space, linear_policy(space, np.array(ridge), N))


def learn(found, features, log_policy, actions, weight):
    """An adversary fitted to steps."""
    return found.fit(FitData.from_steps(features, actions, Discrete(log_policy.shape[1])), log_policy, weight)


def fitted(name: str, n_actions: int, seed: int = 0):
    """An adversary that has seen some steps, so that it is not at its start."""
    features, log_policy, actions = steps(n_actions, seed + 100)
    return learn(named(name, n_actions), features, log_policy, actions, np.random.default_rng(seed).random(N))


def by_action(found, features, log_policy) -> NDArray:
    """psi(k|s) of every action, (N, K)."""
    n, n_actions = log_policy.shape
    columns = [found.log_prob(features, log_policy, np.full(n, k)) for k in range(n_actions)]
    return np.exp(np.stack(columns, axis=1))


def brute_force(name: str, found, features, log_policy) -> NDArray:
    """psi from its definition, (N, K), in plain probabilities."""
    pi = np.exp(log_policy)
    n_actions = pi.shape[1]
    match name:
        case "constant":
            return np.ones_like(pi)
        case "uniform":
            return np.full_like(pi, 1 / n_actions)
        case "marginal":
            return np.tile(np.exp(found.log_frequency), (len(pi), 1))
        case "complement":
            return 1 - pi
        case "normalised complement":
            return (1 - pi) / (n_actions - 1)
        case "confusion":
            return pi @ np.exp(found.log_matrix)
        case "own policy":
            logits = features @ found.policy.weights
            return np.exp(log_softmax(logits, axis=1))
    raise ValueError(name)


@pytest.mark.parametrize("n_actions", [2, 5])
@pytest.mark.parametrize("name", ADVERSARIES["discrete"])
def test_log_prob_is_the_definition(name, n_actions):
    features, log_policy, actions = steps(n_actions)
    found = fitted(name, n_actions)
    assert found.name == name
    expected = brute_force(name, found, features, log_policy)
    np.testing.assert_allclose(by_action(found, features, log_policy), expected, rtol=1e-9)
    np.testing.assert_allclose(
        found.log_prob(features, log_policy, actions), np.log(expected[np.arange(N), actions]), atol=1e-9
    )


@pytest.mark.parametrize("normalised", [False, True])
def test_complement_is_exact_where_the_policy_is_all_but_certain(normalised):
    log_policy = log_softmax(np.array([[0.0, -700.0, -700.0], [0.0, -2000.0, -3000.0]]), axis=1)
    found = Complement(normalised).log_prob(np.empty((2, 0)), log_policy, np.zeros(2, dtype=int))
    np.testing.assert_allclose(found, np.array([-700.0 + np.log(2), -2000.0]) - normalised * np.log(2), rtol=1e-15)


@pytest.mark.parametrize("n_actions", [2, 5])
def test_confusion_contains_the_normalised_complement_and_the_uniform(n_actions):
    features, log_policy, actions = steps(n_actions)
    others = Confusion.given((1 - np.eye(n_actions)) / (n_actions - 1))
    anything = Confusion.given(np.full((n_actions, n_actions), 1 / n_actions))
    for confusion, plain in ((others, Complement(normalised=True)), (anything, Uniform())):
        arguments = features, log_policy, actions
        np.testing.assert_allclose(confusion.log_prob(*arguments), plain.log_prob(*arguments), atol=1e-12)
    intended, own = (one.intended_action_proba(log_policy, actions) for one in (others, Complement()))
    np.testing.assert_allclose(intended, own, atol=1e-12)
    np.testing.assert_allclose(anything.intended_action_proba(log_policy, actions), np.exp(log_policy), atol=1e-12)


@pytest.mark.parametrize("n_actions", [2, 5])
@pytest.mark.parametrize("name", ["complement", "normalised complement", "confusion"])
def test_intended_action_proba_is_the_posterior(name, n_actions):
    """Bayes by enumeration: P(j | a) = P(j) P(a | j) / sum."""
    _, log_policy, actions = steps(n_actions)
    found = fitted(name, n_actions)
    emission = np.exp(found.log_matrix) if name == "confusion" else (1 - np.eye(n_actions)) / (n_actions - 1)
    intended = found.intended_action_proba(log_policy, actions)
    for n in range(N):
        joint = [np.exp(log_policy[n, j]) * emission[j, actions[n]] for j in range(n_actions)]
        np.testing.assert_allclose(intended[n], np.array(joint) / sum(joint), atol=1e-12)
    np.testing.assert_allclose(intended.sum(axis=1), 1.0)


def test_intended_action_proba_of_a_nearly_certain_policy_and_of_other_adversaries():
    _, log_policy, actions = steps(3)
    for name in ("constant", "uniform", "marginal", "own policy"):
        assert fitted(name, 3).intended_action_proba(log_policy, actions) is None
    log_policy = log_softmax(np.array([[0.0, -2000.0, -2000.0 - np.log(3)]]), axis=1)
    intended = Complement().intended_action_proba(log_policy, np.array([0]))
    np.testing.assert_allclose(intended, [[0.0, 0.75, 0.25]], atol=1e-12)


@pytest.mark.parametrize("n_actions", [2, 4])
@pytest.mark.parametrize("name", ADVERSARIES["discrete"])
def test_fit_never_lowers_the_objective(name, n_actions):
    features, log_policy, actions = steps(n_actions)
    weight = np.random.default_rng(0).random(N) * (actions > 0)  # one action never taken

    def objective(found):
        return weight @ found.log_prob(features, log_policy, actions) + found.log_prior()

    found = named(name, n_actions)
    before = objective(found)
    for _ in range(5):
        found = learn(found, features, log_policy, actions, weight)
        after = objective(found)
        assert after >= before - 1e-9
        before = after
    assert np.isfinite(before)


def test_learned_parameters_are_modes():
    """Marginal and confusion under their Dirichlet priors: one pseudo-step an action, and an entry."""
    actions, weight = np.array([0, 0, 1]), np.array([1.0, 0.5, 2.0])
    features, certain = np.empty((3, 0)), np.log(np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]) + 1e-300)
    found = learn(Marginal.start(3), features, certain, actions, weight)
    np.testing.assert_allclose(np.exp(found.log_frequency), np.array([2.5, 3.0, 1.0]) / 6.5)
    learned = learn(Confusion.start(3), features, certain, actions, weight)
    expected = [[2 / 4, 1 / 4, 1 / 4], [1.5 / 3.5, 1 / 3.5, 1 / 3.5], [1 / 5, 3 / 5, 1 / 5]]
    np.testing.assert_allclose(np.exp(learned.log_matrix), expected)


def test_given_confusion_is_never_learned_and_must_be_square_rows_of_distributions():
    given = Confusion.given(np.eye(3)[[1, 2, 0]])
    assert learn(given, *steps(3), np.ones(N)) is given
    assert given.log_prior() == 0.0
    for bad in ([[0.5, 0.5]], [0.5, 0.5], *([first, [0.0, 1.0]] for first in ([1.0, 1.0], [1.5, -0.5], [np.nan, 1.0]))):
        with refused("rows are distributions"):
            Confusion.given(bad)
