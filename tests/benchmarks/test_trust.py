"""The benchmark of trust: generated worlds and their truth, and scores by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import beta, norm, spearmanr
from sklearn.metrics import brier_score_loss, roc_auc_score

GOOD = np.array([1, 1, 1, 0, 0, -1, 1, 0])


# ---- worlds ----------------------------------------------------------------------------------------------------------


def softmax(logits):
    weights = [math.exp(value) for value in logits]
    return [weight / sum(weights) for weight in weights]


@pytest.mark.parametrize("continuous", [False, True])
def test_ratios_of_styles_by_brute_force(continuous):
    from trust_operators import Operators
    from trust_worlds import styles

    world = styles(30, 70, 25, 10, continuous, 3)
    operators = Operators.drawn(30, continuous, np.random.default_rng([3, 30, 70, 25, 10, continuous]))
    assert sorted(world.extra["style"]) == [0] * 7 + [1] * 3
    expected, realised = np.zeros(10), np.zeros(10)
    for state, action, m in zip(world.observations, world.actions, world.episode_ids, strict=True):
        beyond = float(state @ operators.normal) > norm.ppf(0.7)
        logits = [state @ operators.weights[0], state @ operators.weights[1 if beyond else 0]]
        own = world.extra["style"][m]
        if continuous:
            likelihoods = [math.prod(norm.pdf(a, mean) for a, mean in zip(action, of, strict=True)) for of in logits]
            expected[m] += sum((x - y) ** 2 for x, y in zip(*logits, strict=True)) / 2
        else:
            pi = [softmax(of) for of in logits]
            likelihoods = [of[action] for of in pi]
            expected[m] += sum(p * math.log(p / q) for p, q in zip(pi[own], pi[1 - own], strict=True))
        realised[m] += math.log(likelihoods[0] / likelihoods[1])
    np.testing.assert_allclose(world.extra["log_ratio"], expected, atol=1e-9)
    np.testing.assert_allclose(world.extra["style_log_ratio"], realised, atol=1e-9)


@pytest.mark.parametrize("continuous", [False, True])
def test_actions_are_drawn_from_the_policies(continuous):
    """The mean of the realised ratio is the expected one, in the operator's favour."""
    from trust_worlds import styles

    world = styles(30, 50, 400, 60, continuous, 0)
    signed = np.where(world.extra["style"] == 0, 1, -1) * world.extra["style_log_ratio"]
    error = signed - world.extra["log_ratio"]
    assert abs(error.mean()) < 4 * error.std() / np.sqrt(len(error))
    assert signed.mean() > 10


def test_states_of_styles_move_slowly_and_differ_as_often_as_said():
    from trust_operators import MEMORY, Operators, wandering

    states = wandering(50, 400, np.random.default_rng(0))
    assert states.std() == pytest.approx(1, abs=0.03)
    assert np.mean(states[:, 1:] * states[:, :-1]) == pytest.approx(MEMORY, abs=0.03)
    for difference in (5, 10, 30):
        usual, second = Operators.drawn(difference, False, np.random.default_rng(1)).outputs(states.reshape(-1, 8))
        assert 100 * (usual != second).any(axis=1).mean() == pytest.approx(difference, abs=2)


@pytest.mark.parametrize("adversary", ["uniform", "marginal"])
def test_ratios_of_well_specified_worlds_by_brute_force(adversary):
    from trust_worlds import expert_policy, well_specified

    world = well_specified(20, 10, adversary, 2)
    weights, bias = expert_policy(np.random.default_rng([2, 20, 10]))
    many = np.exp(np.random.default_rng(5).normal(size=(100_000, 4)) @ weights + bias)
    marginal = (many / many.sum(axis=1, keepdims=True)).mean(axis=0)
    psi = [0.25] * 4 if adversary == "uniform" else marginal
    found = np.zeros(20)
    for state, action, m in zip(world.observations, world.actions, world.episode_ids, strict=True):
        found[m] += math.log(softmax(state @ weights + bias)[action] / psi[action])
    np.testing.assert_allclose(world.extra["oracle_log_ratio"], found, atol=1e-9 if adversary == "uniform" else 0.1)
    assert world.is_good.sum() == 10
    assert roc_auc_score(world.is_good, found) > 0.9


def test_adversaries_act_as_often_as_said():
    from trust_worlds import well_specified

    uniform, marginal = (well_specified(200, 100, adversary, 0) for adversary in ("uniform", "marginal"))
    assert (uniform.observations == marginal.observations).all()
    steps = marginal.is_good[marginal.episode_ids] == 1
    shares = {k: np.bincount(marginal.actions[steps == k], minlength=4) / 10_000 for k in (True, False)}
    np.testing.assert_allclose(shares[True], shares[False], atol=0.03)
    assert np.ptp(shares[True]) > 0.05
    np.testing.assert_allclose(np.bincount(uniform.actions[~steps]) / 10_000, 0.25, atol=0.03)


@pytest.mark.parametrize("continuous", [False, True])
def test_where_nothing_is_left_states_tell_nothing_of_actions(continuous):
    from trust_worlds import NOTHING, nothing

    for kind in NOTHING[1:]:
        world = nothing(kind, continuous, 0)
        assert world.is_good.sum() == 10
        steps = world.is_good[world.episode_ids] == 1
        targets = world.actions if continuous else np.eye(4)[world.actions]
        coefficients = np.corrcoef(world.observations[steps].T, targets[steps].T)[:8, 8:]
        assert np.abs(coefficients).max() < 0.15  # 1,000 steps: the standard error is .03
    assert nothing(NOTHING[0], continuous, 0).observations.shape == (400, 100)


@pytest.mark.slow
def test_the_list_of_worlds():
    from robustness_report import unknowable
    from trust_worlds import FAMILIES, cells

    every = cells()
    counts = {family: len(cells([family])) for family in FAMILIES}
    assert counts == {"simulated": 2 * (63 + 45), "styles": 2 * (27 + 2 + 9), "nothing": 18, "well-specified": 40}
    for name in list(every)[::97]:
        world, again = every[name].make(), every[name].make()
        assert (world.name, world.family) == (name, every[name].family)
        np.testing.assert_array_equal(world.observations, again.observations)
        np.testing.assert_array_equal(world.actions, again.actions)
        assert (np.diff(world.episode_ids) >= 0).all()
        assert len(world.demonstrations) == len(world.is_good)
    simulated = every["simulated Acrobot-v1 shift 75 % 1001"].make()
    assert (simulated.is_good.sum(), len(simulated.is_good)) == (10, 40)
    assert simulated.extra["unknowable"] == unknowable("shift", 75)
    assert simulated.is_good[:10].sum() < 10  # the order tells nothing


# ---- scores ----------------------------------------------------------------------------------------------------------


def test_ranking_agrees_with_others():
    from trust_scores import ranking, resampled_spearman

    rng = np.random.default_rng(0)
    good = rng.choice([1, 0, -1], 60)
    quality = rng.normal(size=60)
    scores = np.round(quality + good + rng.normal(size=60), 1)
    found = ranking(scores, good, quality, np.random.default_rng(1))
    assert found["auroc"] == pytest.approx(roc_auc_score(good[good >= 0], scores[good >= 0]))
    assert found["spearman"] == pytest.approx(spearmanr(scores, quality).statistic)
    for name in ("auroc", "spearman"):
        low, high = found[f"{name}_ci95"]
        assert low < found[name] < high
    draws = resampled_spearman(scores, quality, good, np.random.default_rng(2))
    slow = []
    for _ in range(400):
        drawn = np.concatenate([rng.choice(np.flatnonzero(good == k), (good == k).sum()) for k in (0, 1, -1)])
        slow.append(spearmanr(scores[drawn], quality[drawn]).statistic)
    assert draws.mean() == pytest.approx(np.mean(slow), abs=0.03)
    assert draws.std() == pytest.approx(np.std(slow), rel=0.2)
    nobody_bad = ranking(scores, np.ones(60), None, rng)
    assert set(nobody_bad.values()) == {None}


def test_verdicts_and_brier_by_hand():
    from trust_scores import exact_interval, judged

    row = {
        "verdicts": ["typical", "open", "unlike", "typical", "unlike", "typical", "typical", "open"],
        "expert_proba": [0.95, 0.5, 0.05, 0.9, 0.1, 0.99, 1.0, 0.6],
    }
    found = judged(row, GOOD, np.random.default_rng(0))
    assert list(found["verdicts"]["good"].values()) == [2, 1, 1]
    assert list(found["verdicts"]["bad"].values()) == [1, 1, 1]
    assert list(found["verdicts"]["between"].values()) == [1, 0, 0]
    assert (found["wrong"], found["given"], found["answered"]) == (2, 5, 6 / 8)
    # Clopper and Pearson by their quantiles of beta distributions
    np.testing.assert_allclose(found["wrong_ci95"], [beta.ppf(0.025, 2, 4), beta.ppf(0.975, 3, 3)])
    assert exact_interval(0, 0) is None
    known = GOOD >= 0
    assert found["brier"] == pytest.approx(brier_score_loss(GOOD[known], np.array(row["expert_proba"])[known]))
    assert found["base_rate_brier"] == pytest.approx(brier_score_loss(GOOD[known], np.full(7, 4 / 7)))
    low, high = found["brier_ci95"]
    assert low < found["brier"] < high


def test_length_is_added_and_taken_away():
    from trust_peers import add_length
    from trust_scores import rankings

    lengths = np.array([10, 20, 30, 40])
    np.testing.assert_array_equal(add_length(np.array([1.0, 2.0, 4.0, 3.0]), lengths), [2, 4, 7, 7])
    np.testing.assert_array_equal(add_length(np.array([3.0, 4.0, 2.0, 1.0]), lengths), [2, 2, -1, -3])
    np.testing.assert_array_equal(add_length(np.ones(4), lengths), np.full(4, 2.5))
    rows = {"rpil": {"scores": [3.0, 1, 0, 2], "length": [2.0, 0, 1, -1]}, "pooled": {"scores": [1.0, 2, 4, 3]}}
    found = rankings({"lengths": lengths}, rows)
    np.testing.assert_array_equal(found["rpil without length"], [1, 1, -1, 3])
    np.testing.assert_array_equal(found["pooled + length"], [2, 4, 7, 7])


def test_new_and_old_audits_are_described_alike():
    from trust import described

    odds = np.array([2.0, -1.0])
    audit = SimpleNamespace(log_odds=odds, expert_proba=odds, verdicts=("expert", "open"), ids=(0, 1))
    audit.identifiable, audit.competing = False, ((1,), (0,))
    old = described(audit)
    assert (old["finding"], old["length"], old["groups"]) == ("two groups", [0.0, 0.0], [[1], [0]])
    audit.finding, audit.evidence = "nobody stands out", {"actions": odds - 3, "length": np.full(2, 3.0)}
    new = described(audit)
    assert (new["finding"], new["length"], new["scores"]) == ("nobody stands out", [3.0, 3.0], [2.0, -1.0])


def test_styles_and_the_oracle_by_hand():
    from trust_scores import against_oracle, of_styles

    extra = {"style": [0, 0, 0, 1, 1, 1], "log_ratio": [20.0] * 6, "style_log_ratio": [1.0, 2, 3, 0, -1, 1.5]}
    ours = {"verdicts": ["typical"] * 4 + ["unlike"] * 2, "groups": [[3, 4]]}
    ours["labelled"] = {"labels": {"5": "bad"}, "scores": [3.0, 2, 1, 1, 0, -9]}
    found = of_styles(extra, ours)
    assert (found["accused"], found["style_listed"], found["oracle_auroc"]) == (2, True, 1.0)
    assert found["label_auroc"] == pytest.approx(5.5 / 6)  # the labelled one is left out
    assert not of_styles(extra, ours | {"groups": [[2, 3, 4]]})["style_listed"]  # a third of it is of the other
    assert not of_styles(extra, ours | {"groups": [[3]]})["style_listed"]  # a third of the style

    odds = np.array([3.0, 3.0, 1.0, -3.0])
    ours = {"verdicts": ["typical", "unlike", "unlike", "open"], "expert_proba": [0.95, 0.1, 0.04, 0.5]}
    found = against_oracle(odds, ours, np.array([1, 0, 0, 0]))
    assert (found["oracle_correct"], found["oracle_wrong"], found["correct"]) == (2, 1, 3)
    assert found["wrong_expected"] == pytest.approx(0.05 + 0.1 + 0.04)
