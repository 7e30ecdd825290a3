"""Neural policies: the same bits for the same seed, no memory of bad data, and clear words where something is wrong."""

from __future__ import annotations

import sys
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from scipy.special import expit
from sklearn.metrics import roc_auc_score

from problems import make, refused
from rpil import RPIL, Demonstrations, TorchPolicy, save
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Discrete
from rpil.inference.held_out import HeldOutPolicy
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.inference.trust import judge
from rpil.policies.networks import initial_networks
from rpil.policies.torch import training_and_validation

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'rpil[torch]'")


def nonlinear(seed: int, n: int = 30, steps: int = 40, n_bad: int = 12, n_idle: int = 0) -> tuple[FitData, np.ndarray]:
    """A rule that no linear policy knows, 5 % of all actions being anything, and `n_bad` demonstrations at random."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n * steps, 2 + n_idle))
    actions = rule(x)
    good = rng.permutation(n) >= n_bad
    loose = (rng.random(len(x)) < 0.05) | ~np.repeat(good, steps)
    actions[loose] = rng.integers(3, size=loose.sum())
    return FitData(x, actions, np.arange(n + 1) * steps, Discrete(3), np.zeros(n, dtype=int)), good


def rule(x: np.ndarray) -> np.ndarray:
    return np.where(x[:, 0] * x[:, 1] > 0, np.where(x[:, 0] > 0, 2, 0), 1)


def continuous(seed: int, n: int = 24, steps: int = 40, n_bad: int = 8) -> tuple[FitData, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n * steps, 2))
    actions = wave(x) + 0.1 * rng.normal(size=(len(x), 2))
    good = rng.permutation(n) >= n_bad
    bad = ~np.repeat(good, steps)
    actions[bad] = rng.uniform(-2, 2, size=(bad.sum(), 2))
    return FitData(x, actions, np.arange(n + 1) * steps, Box(np.full(2, -2.5), np.full(2, 2.5)), np.zeros(n, int)), good


def wave(x: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(2 * x[:, 0]), np.abs(x[:, 1]) - 1], axis=1)


def judged(problem: FitData, policy: TorchPolicy) -> tuple[np.ndarray, TorchPolicy]:
    """Log-odds of the demonstrations, and the policy of those that are trusted."""
    policy = policy.for_space(problem.space)
    log_odds = judge(problem, HeldOutPolicy(problem, policy, HeldOutSettings()), JudgeSettings()).log_odds
    return log_odds, policy.fit(problem, problem.per_step(expit(log_odds)))[0]


def accuracy(policy: TorchPolicy, n_idle: int = 0) -> float:
    x = np.random.default_rng(99).normal(size=(4000, 2 + n_idle))
    return float((policy.outputs(x).argmax(axis=1) == rule(x)).mean())


def test_same_seed_same_bits_and_no_other_random_state_is_touched():
    problem, _ = nonlinear(0, n=10, n_bad=3)
    weight = np.random.default_rng(1).random(len(problem.actions))
    quick = TorchPolicy(hidden=(16,), epochs=4, seed=7)
    torch.manual_seed(0)
    np.random.seed(0)  # noqa: NPY002
    threads = torch.get_num_threads()
    states = torch.get_rng_state(), np.random.get_state()[1].copy()  # noqa: NPY002
    policy, outputs = quick.fit(problem, weight)
    _, more = policy.fit(problem, weight)
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.get_rng_state(), states[0])
    np.testing.assert_array_equal(np.random.get_state()[1], states[1])  # noqa: NPY002
    torch.manual_seed(5)
    again, same = quick.fit(problem, weight)
    np.testing.assert_array_equal(outputs, same)
    np.testing.assert_array_equal(more, again.fit(problem, weight)[1])
    np.testing.assert_array_equal(
        policy.fit_all(problem, weight).outputs(problem.features),
        again.fit_all(problem, weight).outputs(problem.features),
    )
    assert (replace(quick, seed=8).fit(problem, weight)[1] != outputs).any()


def test_instances_do_not_change():
    problem, _ = nonlinear(0, n=6, n_bad=2)
    policy, _ = TorchPolicy(hidden=(8,), epochs=2).fit(problem, np.ones(len(problem.actions)))
    before = policy.outputs(problem.features)
    policy.fit(problem, problem.per_step(np.arange(6.0)))
    policy.fit_all(problem, problem.per_step(np.arange(6.0)))
    np.testing.assert_array_equal(policy.outputs(problem.features), before)
    with pytest.raises(FrozenInstanceError):
        policy.seed = 1
    with pytest.raises(ValueError, match="read-only"):
        policy.trained.networks[0][:] = 0.0


def test_outputs_are_those_of_networks_that_did_not_see_the_step():
    """Whatever a demonstration does, the network that judges it stays as it was, to the bit."""
    problem, _ = nonlinear(0, n=9, steps=20, n_bad=0)
    hasty = TorchPolicy(hidden=(8,), n_folds=3, epochs=3, patience=None)
    everybody = np.ones(len(problem.actions))
    policy, outputs = hasty.fit(problem, everybody)
    number = hasty._unit_of_step(problem)[problem.offsets[:-1]]
    m = int(np.flatnonzero(number % 3 == 1)[0])
    without = np.where(problem.per_step(np.arange(9) == m), 0.0, everybody)
    mine = slice(problem.offsets[m], problem.offsets[m + 1])
    _, changed = hasty.fit(problem, without)
    same_fold = problem.per_step(number % 3 == 1)
    # Batches are drawn among the steps that count, so it is what was learned that is compared, not the bits.
    np.testing.assert_allclose(np.exp(changed[mine]), np.exp(outputs[mine]), atol=0.2)
    networks = policy.trained.networks
    alone = tuple(layer[1:2] for layer in networks)
    single = replace(policy, trained=replace(policy.trained, networks=alone))
    np.testing.assert_array_equal(single.outputs(problem.features)[same_fold], outputs[same_fold])


def test_on_other_data_it_is_the_mean_of_the_networks():
    problem, _ = nonlinear(0, n=6, n_bad=0)
    policy, _ = TorchPolicy(hidden=(8,), n_folds=3, epochs=3).fit(problem, np.ones(len(problem.actions)))
    x = np.random.default_rng(0).normal(size=(50, 2))
    each = [
        replace(policy, trained=replace(policy.trained, networks=tuple(p[k : k + 1] for p in policy.trained.networks)))
        for k in range(3)
    ]
    mean = np.mean([np.exp(one.outputs(x)) for one in each], axis=0)
    np.testing.assert_allclose(np.exp(policy.outputs(x)), mean)
    np.testing.assert_allclose(mean.sum(axis=1), 1.0)


def test_folds_do_not_depend_on_the_order():
    problem, _ = nonlinear(0, n=8, n_bad=0)
    quick = TorchPolicy(hidden=(8,), n_folds=4)
    order = np.array([5, 0, 7, 1, 2, 3, 6, 4])
    firsts = quick._unit_of_step(problem)[problem.offsets[:-1]]
    mixed = problem.select(order)
    np.testing.assert_array_equal(quick._unit_of_step(mixed)[mixed.offsets[:-1]], firsts[order])


def test_no_network_learns_what_it_is_judged_by():
    rng = np.random.default_rng(0)
    number = np.repeat(rng.permutation(9), 11)
    few = np.where(number == 4, 1.0, 0.0)
    for n_folds in (1, 3):
        for mass in (np.ones(99), rng.random(99), few):
            learn, judge = training_and_validation(number, n_folds, mass)
            assert not (learn & judge).any()
            assert ((learn @ mass > 0) & (judge @ mass > 0)).any(), "somebody who learned must be judged"
            if n_folds > 1:
                assert not (learn & (np.arange(3)[:, None] == number % 3)).any()


def test_recovers_a_linear_softmax_expert():
    toy = make("none", 0, n_good=30, n_bad=0, steps=(60, 80), sharpness=2.0)
    problem = FitData(toy.observations, toy.actions, toy.offsets, Discrete(3), toy.labels)
    truth = toy.observations @ toy.weights[:-1] + toy.weights[-1]
    truth = truth - np.log(np.exp(truth).sum(axis=1, keepdims=True))
    policy, outputs = TorchPolicy(hidden=(32,)).fit(problem, np.ones(len(toy.actions)))
    for found in (outputs, policy.fit_all(problem, np.ones(len(toy.actions))).outputs(toy.observations)):
        assert (np.exp(truth) * (truth - found)).sum(axis=1).mean() < 0.03  # Kullback-Leibler, nats


def test_steps_count_by_their_weight():
    """Two demonstrators who contradict each other: the weights say whom to believe."""
    problem, _ = nonlinear(0, n=20, n_bad=0)
    opposed = replace(
        problem, actions=np.where(problem.per_step(np.arange(20) % 2), problem.actions, 2 - problem.actions)
    )
    quick = TorchPolicy(hidden=(32,))
    trust = opposed.per_step((np.arange(20) % 2).astype(float))
    assert accuracy(quick.fit_all(opposed, trust)) > 0.85


def test_a_nonlinear_expert_among_many_who_act_at_random():
    problem, good = nonlinear(1)
    log_odds, policy = judged(problem, TorchPolicy(seed=1, n_folds=3))
    assert roc_auc_score(good, log_odds) > 0.99
    assert ((log_odds > 0) == good).mean() > 0.95
    weight = problem.per_step(expit(log_odds))
    clean = accuracy(TorchPolicy(seed=1).fit_all(problem, problem.per_step(good.astype(float))))
    assert accuracy(policy.fit_all(problem, weight)) > clean - 0.02
    assert clean > 0.9


def test_a_large_network_memorises_bad_data_only_in_sample():
    """Eighteen useless observations are enough to remember every single step by."""
    problem, good = nonlinear(0, n_idle=18)
    bad = problem.per_step(~good)

    def explained(policy: TorchPolicy) -> float:
        """Mean log-probability of the bad steps, where all teach."""
        policy, outputs = policy.fit(problem, np.ones(len(bad)))
        return float(policy.log_prob(outputs, problem.actions)[bad].mean())

    assert explained(TorchPolicy(hidden=(256,), n_folds=1, epochs=60, patience=None)) > -0.5
    assert explained(TorchPolicy(hidden=(256,))) < np.log(1 / 3)
    log_odds, _ = judged(problem, TorchPolicy(hidden=(256,)))
    assert expit(log_odds[~good]).mean() < 0.01
    assert roc_auc_score(good, log_odds) > 0.99


def test_continuous_actions():
    problem, good = continuous(0)
    log_odds, policy = judged(problem, TorchPolicy(hidden=(32, 32), n_folds=3))
    assert roc_auc_score(good, log_odds) == 1.0
    noise = policy.trained.head.noise
    assert np.sqrt(np.diag(noise.cholesky @ noise.cholesky.T)) == pytest.approx([0.1, 0.1], abs=0.08)
    final = policy.fit_all(problem, problem.per_step(expit(log_odds)))
    x = np.random.default_rng(9).uniform(-1.5, 1.5, size=(2000, 2))
    assert np.abs(final.outputs(x) - wave(x)).mean() < 0.1


def test_untrained_it_says_nothing():
    x = np.zeros((4, 2))
    policy = TorchPolicy().for_space(Discrete(3))
    np.testing.assert_allclose(policy.outputs(x), -np.log(3))
    np.testing.assert_allclose(policy.log_prob(policy.outputs(x), np.array([0, 1, 2, 0])), -np.log(3))
    box = Box(np.array([0.0]), np.array([4.0]))
    np.testing.assert_allclose(TorchPolicy(space=box).outputs(x), 2.0)
    networks = initial_networks((2, 5, 3), 4, np.random.default_rng(0))
    assert [layer.shape for layer in networks] == [(4, 2, 5), (4, 1, 5), (4, 5, 3), (4, 1, 3)]


@pytest.mark.parametrize("n", [1, 2])
def test_few_demonstrations_are_cut_into_pieces(n):
    problem, _ = nonlinear(0, n=n, steps=300, n_bad=0)
    policy, outputs = TorchPolicy(hidden=(32,)).fit(problem, np.ones(len(problem.actions)))
    assert len(np.unique(policy._unit_of_step(problem))) == 20
    assert np.isfinite(outputs).all()
    steps = FitData.from_steps(problem.features, problem.actions, problem.space)
    assert accuracy(policy.fit_all(steps, np.ones(len(problem.actions)))) > 0.7


def test_a_single_trusted_demonstration_teaches_what_it_can():
    problem, _ = nonlinear(0, steps=150, n_bad=0)
    policy, _ = TorchPolicy(hidden=(32,)).fit(problem, problem.per_step((np.arange(30) == 3).astype(float)))
    assert accuracy(policy) > 0.6
    _, nothing = TorchPolicy().fit(problem, np.zeros(len(problem.actions)))
    np.testing.assert_allclose(nothing, -np.log(3), rtol=1e-6)


def test_rpil_with_a_network():
    problem, good = nonlinear(0, n=20, n_bad=8)
    words = np.array(["left", "none", "right"])
    data = Demonstrations(problem.features, words[problem.actions], problem.offsets)
    model = RPIL(policy=TorchPolicy(hidden=(32,))).fit(data)
    assert roc_auc_score(good, model.audit_.log_odds) > 0.99
    x = np.random.default_rng(99).normal(size=(2000, 2))
    assert (model.predict(x) == words[rule(x)]).mean() > 0.85
    np.testing.assert_allclose(model.predict_proba(x).sum(axis=1), 1.0)
    with pytest.raises(DataError, match=r"TorchPolicy cannot be saved"):
        save(model, "nowhere.rpil")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"hidden": (8, 0)}, r"hidden=\(8, 0\)"),
        ({"epochs": 0}, "epochs=0"),
        ({"batch_size": -1}, "batch_size=-1"),
        ({"n_folds": 0}, "n_folds=0"),
        ({"patience": 0}, "patience=0"),
        ({"learning_rate": float("nan")}, "learning_rate=nan"),
    ],
)
def test_parameters_that_make_no_sense(wrong, words):
    with refused(words):
        TorchPolicy(**wrong)


def test_what_is_not_finite_is_said_in_one_sentence():
    problem, _ = nonlinear(0, n=6, n_bad=0)
    ones = np.ones(len(problem.actions))
    broken = problem.features.copy()
    broken[17] = np.nan
    quick = TorchPolicy(hidden=(8,), epochs=3)
    with np.errstate(invalid="ignore"), refused("loss is not finite in epoch 1"):
        quick.fit(replace(problem, features=broken), ones)
    policy, _ = quick.fit(problem, ones)
    with refused("outputs are not finite"):
        policy.outputs(broken)
    with pytest.raises(DataError, match="call fit first"):
        TorchPolicy().outputs(problem.features)
    with pytest.raises(DataError, match="device='nowhere'"):
        replace(quick, device="nowhere").fit(problem, ones)
    if not torch.cuda.is_available():
        with pytest.raises(DataError, match="device='cuda'"):
            replace(quick, device="cuda").fit(problem, ones)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_cuda_agrees_with_the_cpu():
    problem, good = nonlinear(0)
    log_odds, _ = judged(problem, TorchPolicy(device="cuda"))
    assert roc_auc_score(good, log_odds) > 0.99


def test_without_torch_the_extra_is_named(monkeypatch):
    problem, _ = nonlinear(0, n=6, n_bad=0)
    monkeypatch.setitem(sys.modules, "torch", None)
    with refused(r"rpil\[torch\]", MissingExtraError):
        TorchPolicy().fit(problem, np.ones(len(problem.actions)))
    untouched = TorchPolicy(space=Discrete(3)).outputs(problem.features)
    assert untouched.shape == (240, 3)
