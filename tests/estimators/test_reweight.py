"""The judge around a policy of somebody else's: NumPy here, torch in the examples and below."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import log_softmax
from sklearn.metrics import roc_auc_score

from problems import Toy, make, refused
from rpil import Demonstrations, reweight
from rpil.data.errors import DataError

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


@pytest.mark.parametrize("n_folds", [1, 3])
def test_reweight_of_a_numpy_policy(n_folds):
    mine = Linear()
    found = reweight(mine, TOY.demonstrations, log_prob=log_prob, train=train, n_folds=n_folds)
    assert found.policy is mine
    assert found.converged
    assert mine.trained >= found.n_rounds > 1
    assert found.audit.ids == TOY.ids
    assert roc_auc_score(TOY.is_good, found.audit.log_odds) == 1.0
    assert set(found.audit.verdicts) == {"similar", "outlier"}
    assert found.step_weight.shape == TOY.actions.shape
    assert 0.0 <= found.step_weight.min() <= found.step_weight.max() <= 1.0
    assert abs(found.audit.prior.mean - 0.6) < 0.2
    assert agrees(mine, TOY) > 0.93
    assert ("memorise" in " ".join(found.audit.assumptions)) == (n_folds == 1)


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


def test_labels_decide_log_odds_of_reweight():
    toy = make("flipped", 1, n_good=5, n_bad=7, steps=(30, 40))
    labels = {f"d{m}": "bad" for m in range(5, 9)} | {"d0": "good"}
    found = reweight(Linear(), toy.demonstrations, log_prob=log_prob, train=train, labels=labels)
    assert (found.audit.log_odds[5:9] < -3).all()
    assert found.audit.log_odds[0] > 3
    assert found.step_weight[toy.groups == 6].max() < 0.05


def test_continuous_actions():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(20, 40, 2))
    actions = x @ [[1.0], [-1.0]] + 0.1 * rng.normal(size=(20, 40, 1))
    good = np.arange(20) < 12
    actions[~good] = rng.uniform(-3, 3, size=(8, 40, 1))
    data = Demonstrations(x.reshape(-1, 2), actions.reshape(-1, 1), np.arange(21) * 40)

    def density(policy, observations, actions):
        left = (actions - observations @ policy.mean)[:, 0]
        return -0.5 * (left / policy.scale) ** 2 - np.log(policy.scale * np.sqrt(2 * np.pi))

    def least_squares(policy, observations, actions, weights):
        moments = (observations.T * weights) @ observations
        policy.mean = np.linalg.solve(moments, (observations.T * weights) @ actions)
        left = (actions - observations @ policy.mean)[:, 0]
        policy.scale = np.sqrt(weights @ left**2 / weights.sum()) + 0.01

    start = SimpleNamespace(mean=np.zeros((2, 1)), scale=1.0)
    found = reweight(start, data, log_prob=density, train=least_squares)
    assert roc_auc_score(good, found.audit.log_odds) == 1.0
    np.testing.assert_allclose(found.policy.mean, [[1.0], [-1.0]], atol=0.05)


def test_minus_infinite_log_prob_lowers_log_odds():
    """A policy may be certain, and wrong."""

    def certain(policy, observations, actions):
        found = log_prob(policy, observations, actions)
        return np.where(found < np.log(0.2), -np.inf, found)

    found = reweight(Linear(), TOY.demonstrations, log_prob=certain, train=train, n_folds=1)
    assert np.isfinite(found.audit.log_odds).all()
    assert roc_auc_score(TOY.is_good, found.audit.log_odds) == 1.0


def test_progress():
    said = []
    reweight(Linear(), TOY.demonstrations, log_prob=log_prob, train=train, max_rounds=2, progress=said.append)
    assert said[:4] == ["ridge", "fitting the training group", "round 1", "round 2"]
    assert said[-1].startswith("training the policy: ")


def nan_after_training(policy, observations, actions):
    found = log_prob(policy, observations, actions)
    found[3] = np.nan if policy.trained else found[3]
    return found


def frozen_elsewhere(policy, observations, actions, weights):
    """As with an optimiser that was made for the original."""


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"log_prob": nan_after_training}, r"demonstration 'd\d+': log_prob returned nan at step 3"),
        ({"log_prob": lambda p, o, a: np.zeros((len(a), 3))}, r"log_prob returned the shape \(\d+, 3\)"),
        ({"log_prob": lambda p, o, a: 0.0}, r"log_prob returned the shape \(\)"),
        ({"log_prob": lambda p, o, a: None}, r"log_prob returned the shape|log_prob returned NoneType"),
        ({"log_prob": lambda p, o, a: {"a": 1}}, "log_prob returned dict"),
        ({"log_prob": lambda p, o, a: np.exp(log_prob(p, o, a))}, "take logarithms"),
        ({"train": lambda p, o, a, w: 0.37}, "train returned float; let it return nothing, or the new policy"),
        ({"train": frozen_elsewhere}, "train changed nothing in copies"),
        ({"n_folds": 0}, "n_folds=0"),
        ({"n_folds": 21}, "n_folds=21"),
        ({"max_rounds": 0}, "max_rounds=0"),
        ({"labels": {"d99": "good"}}, "d99"),
    ],
)
def test_invalid_functions_and_options_are_refused_in_one_sentence(wrong, words):
    with refused(words):
        reweight(Linear(), TOY.demonstrations, **({"log_prob": log_prob, "train": train} | wrong))


def test_reweight_refuses_arrays_and_a_single_demonstration():
    with pytest.raises(DataError, match="needs Demonstrations, not ndarray"):
        reweight(Linear(), TOY.observations, log_prob=log_prob, train=train)
    with pytest.raises(DataError, match="one demonstration alone"):
        reweight(Linear(), TOY.demonstrations.select([0]), log_prob=log_prob, train=train)


def test_steps_keep_weight_where_no_demonstration_is_trusted():
    def never(policy, observations, actions):
        return np.full(len(actions), -50.0 - 1e-3 * policy.trained)

    weights = []

    def note(policy, observations, actions, trust):
        policy.trained += 1
        weights.append(trust.sum())

    found = reweight(Linear(), TOY.demonstrations, log_prob=never, train=note, max_rounds=3)
    assert "similar" not in found.audit.verdicts
    assert min(weights) > 0.0


def test_reweight_of_a_torch_module_with_its_optimiser(request):
    torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'rpil[torch]'")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # a network so small only loses by more
    request.addfinalizer(lambda: torch.set_num_threads(threads))

    class Learner:
        def __init__(self):
            generator = torch.Generator().manual_seed(0)
            self.net = torch.nn.Sequential(torch.nn.Linear(2, 32), torch.nn.ReLU(), torch.nn.Linear(32, 3))
            for layer in self.net.parameters():
                torch.nn.init.uniform_(layer, -0.3, 0.3, generator=generator)
            self.adam = torch.optim.Adam(self.net.parameters(), lr=0.02)

    def tensor_log_prob(learner, observations, actions):
        chosen = torch.as_tensor(actions)[:, None]
        logits = learner.net(torch.as_tensor(observations, dtype=torch.float32))
        return torch.log_softmax(logits, dim=-1).gather(1, chosen)[:, 0]  # with a gradient: nobody minds

    def epoch(learner, observations, actions, weights):
        for _ in range(20):
            learner.adam.zero_grad()
            loss = -(torch.as_tensor(weights) * tensor_log_prob(learner, observations, actions)).mean()
            loss.backward()
            learner.adam.step()

    found = reweight(Learner(), TOY.demonstrations, log_prob=tensor_log_prob, train=epoch)
    assert roc_auc_score(TOY.is_good, found.audit.log_odds) == 1.0
    outside = Learner()
    elsewhere = torch.optim.Adam(outside.net.parameters())

    def epoch_elsewhere(learner, observations, actions, weights):
        elsewhere.zero_grad()
        (-tensor_log_prob(learner, observations, actions).mean()).backward()
        elsewhere.step()

    with pytest.raises(DataError, match="keep the optimiser with the policy"):
        reweight(outside, TOY.demonstrations, log_prob=tensor_log_prob, train=epoch_elsewhere)


def test_reweight_judges_copies_once():
    every = np.concatenate([np.arange(len(TOY.ids)), np.zeros(5, dtype=int)])
    rows = np.concatenate([np.arange(TOY.offsets[m], TOY.offsets[m + 1]) for m in every])
    offsets = np.append(0, np.cumsum(np.diff(TOY.offsets)[every]))
    data = Demonstrations.from_arrays(TOY.observations[rows], TOY.actions[rows], offsets)
    once, more = (
        reweight(Linear(), each, log_prob=log_prob, train=train, max_rounds=4) for each in (TOY.demonstrations, data)
    )
    np.testing.assert_array_equal(more.audit.log_odds, once.audit.log_odds[every])
    assert more.step_weight.shape == data.actions.shape
    assert more.audit.notes == ("5 demonstrations are copies of 1 other: each is judged once.",)
    assert (more.policy.weights != once.policy.weights).any()  # it learns from copies as well


@dataclass
class Line:
    """Least squares with normal errors."""

    weights: np.ndarray = field(default_factory=lambda: np.zeros((4, 2)))


def log_density(policy, observations, actions):
    away = (actions - np.c_[observations, np.ones(len(actions))] @ policy.weights) / 0.2
    return -0.5 * (away**2).sum(axis=1) - 2 * np.log(0.2 * np.sqrt(2 * np.pi))


def least_squares(policy, observations, actions, weights):
    x = np.c_[observations, np.ones(len(actions))]
    policy.weights = np.linalg.solve(
        (x * weights[:, None]).T @ x + 1e-3 * np.eye(4), (x * weights[:, None]).T @ actions
    )


def styles(n=9, m=7):
    """Demonstrations of two policies."""
    rng, episodes = np.random.default_rng(0), []
    for k in range(n + m):
        states = rng.normal(size=(80, 3))
        own = states @ ([1.0, -0.7, 0.3] if k < n else [-1.0, 0.5, 0.9])
        episodes.append((states, np.column_stack([own, states[:, 0]]) + 0.1 * rng.normal(size=(80, 2))))
    return episodes


def test_reweight_keeps_the_sentences_about_two_groups():
    episodes = styles()
    data = Demonstrations.from_episodes([*episodes, episodes[0]])
    audit = reweight(Line(), data, log_prob=log_density, train=least_squares).audit
    assert audit.finding == "two groups"
    assert audit.notes[0].startswith("The two groups: ")
    assert audit.notes[-1] == "One demonstration is a copy of 1 other: each is judged once."


def test_reweight_of_copies_of_one_or_two_demonstrations():
    first, *_, last = styles()
    alone = Demonstrations.from_episodes([first] * 5)
    audit = reweight(Line(), alone, log_prob=log_density, train=least_squares).audit
    assert (audit.finding, audit.pair) == ("nothing could be learned", ())
    assert audit.notes == ("All 5 demonstrations are copies of one: there is nothing to compare.",)
    with pytest.raises(DataError, match="n_folds=6, but there are 5 demonstrations; give fewer folds"):
        reweight(Line(), alone, log_prob=log_density, train=least_squares, n_folds=6)
    two = Demonstrations.from_episodes([first, last] * 3)
    with pytest.raises(DataError, match="n_folds=3, but there are 2 different demonstrations; give fewer folds"):
        reweight(Line(), two, log_prob=log_density, train=least_squares)
