"""The judge around a policy of somebody else's: NumPy here, torch in the examples."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.special import log_softmax
from sklearn.metrics import roc_auc_score

from problems import Toy, make, refused
from rpil import reweight
from rpil.estimators.reweight import TrainedPolicy

TOY = make("random", 0, n_good=12, n_bad=8, steps=(30, 50))


@dataclass
class Linear:
    """A softmax policy and its optimiser: gradient steps with momentum."""

    weights: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    momentum: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    trained: int = 0


def log_prob(policy, observations, actions):
    logits = np.c_[observations, np.ones(len(actions))] @ policy.weights
    return log_softmax(logits, axis=1)[np.arange(len(actions)), actions]


def train(policy, observations, actions, weights, n_steps=20):
    x = np.c_[observations, np.ones(len(actions))]
    for _ in range(n_steps):
        surprise = np.eye(3)[actions] - np.exp(log_softmax(x @ policy.weights, axis=1))
        policy.momentum = 0.8 * policy.momentum + x.T @ (weights[:, None] * surprise) / weights.sum()
        policy.weights = policy.weights + policy.momentum
    policy.trained += 1


def agrees(policy, toy: Toy) -> float:
    x = np.random.default_rng(5).normal(size=(3000, 2))
    acts = np.argmax(np.c_[x, np.ones(3000)] @ policy.weights, axis=1)
    return float((acts == np.argmax(x @ toy.weights[:-1] + toy.weights[-1], axis=1)).mean())


@pytest.mark.parametrize("n_folds", [1, 3, 21])  # the last is more than there are demonstrations
def test_reweight_of_a_numpy_policy(n_folds):
    mine = Linear()
    found = reweight(mine, TOY.demonstrations, log_prob=log_prob, train=train, n_folds=n_folds)
    assert found.policy is mine
    assert found.converged
    assert mine.trained >= found.n_rounds > 1
    assert found.audit.ids == TOY.ids
    assert roc_auc_score(TOY.is_good, found.audit.log_odds) == 1.0
    assert set(found.audit.verdicts) == {"open", "outlier"}
    assert found.audit.step_weight.shape == TOY.actions.shape
    assert 0.0 <= found.audit.step_weight.min() <= found.audit.step_weight.max() <= 1.0
    assert abs(found.audit.prior.mean - 0.6) < 0.2
    assert agrees(mine, TOY) > 0.93
    assert ("memorise" in " ".join(found.audit.method)) == (n_folds == 1)


def test_reweight_gives_same_bits_and_changes_no_demonstration():
    data = TOY.demonstrations
    before = data.observations.copy()

    def careless(policy, observations, actions, weights):
        train(policy, observations, actions, weights)
        observations[:] = weights[:] = 0.0  # what it is given is its own
        actions[:] = 0

    kept = [reweight(Linear(), data, log_prob=log_prob, train=careless, max_rounds=4) for _ in range(2)]
    np.testing.assert_array_equal(kept[0].audit.log_odds, kept[1].audit.log_odds)
    np.testing.assert_array_equal(data.observations, before)


def test_train_returns_a_new_policy():
    def anew(weights, observations, actions, trust):
        policy = Linear(weights)
        train(policy, observations, actions, trust)
        return policy.weights

    found = reweight(
        np.zeros((3, 3)), TOY.demonstrations, log_prob=lambda w, o, a: log_prob(Linear(w), o, a), train=anew
    )
    assert roc_auc_score(TOY.is_good, found.audit.log_odds) == 1.0
    assert agrees(Linear(found.policy), TOY) > 0.93


def test_log_prob_is_held_out():
    asked, taught = {}, {}

    def spy_log_prob(policy, observations, actions):
        asked.setdefault(policy.weights.tobytes(), set()).update(observations[:, 0])
        return log_prob(policy, observations, actions)

    def spy_train(policy, observations, actions, weights):
        train(policy, observations, actions, weights)
        taught.setdefault(policy.weights.tobytes(), set()).update(observations[weights > 0, 0])

    reweight(Linear(), TOY.demonstrations, log_prob=spy_log_prob, train=spy_train, n_folds=4, max_rounds=3)
    both = set(asked) & set(taught)
    assert len(both) >= 4
    for weights in both:
        assert not asked[weights] & taught[weights]


def test_training_ends_after_three_rounds_without_a_gain_and_no_action_is_impossible():
    means, fold = [-3.0, -2.0, -2.1, -2.1, -1.0, -1.5, -1.5, -1.5, 0.0], 0 * TOY.actions

    def after_rounds(policy, observations, actions):
        return np.full(len(actions), means[policy.trained])

    model = TrainedPolicy(Linear(), TOY.problem(), TOY.demonstrations, after_rounds, train, fold, 50, print)
    counts = np.bincount(TOY.actions) + 1.0
    expected = np.log(0.99 * np.exp(-1.0) + 0.01 * (counts / counts.sum())[TOY.actions])
    np.testing.assert_allclose(model.evaluate(np.ones(len(fold)), 0.0), expected)


def nan_after_training(policy, observations, actions):
    found = log_prob(policy, observations, actions)
    found[3] = np.nan if policy.trained else found[3]
    return found


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"log_prob": nan_after_training}, r"demonstration 'd\d+': log_prob returned nan at step 3"),
        ({"log_prob": lambda p, o, a: np.zeros((len(a), 3))}, r"log_prob returned ndarray of shape \(\d+, 3\)"),
        ({"log_prob": lambda p, o, a: None}, r"log_prob returned NoneType of shape \(\)"),
        ({"log_prob": lambda p, o, a: {"a": 1}}, "log_prob returned dict"),
        ({"log_prob": lambda p, o, a: np.exp(log_prob(p, o, a))}, "take logarithms"),
        ({"train": lambda p, o, a, w: 0.37}, "train returned float; let it return nothing, or the new policy"),
        ({"train": lambda *_: None}, "train changed nothing in copies"),  # its optimiser is of the original
        ({"max_rounds": 0}, "max_rounds=0"),
        ({"labels": {"d99": "good"}}, "d99"),
    ],
)
def test_invalid_functions_and_options_are_refused_in_one_sentence(wrong, words):
    with refused(words):
        reweight(Linear(), TOY.demonstrations, **({"log_prob": log_prob, "train": train} | wrong))
