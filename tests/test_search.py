"""Starts, the best objective, and the adversary that predicts demonstrations it has not seen."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import rpil.search as search_module
from problems import Toy, make, pooled_state, ridge, zoo
from rpil import parallel
from rpil.adversaries import AUTO, Marginal, Uniform
from rpil.crossfit import unseen, untold
from rpil.em import MStep, e_step, run
from rpil.policies import SoftmaxPolicy
from rpil.priors import Share
from rpil.problem import Problem
from rpil.reliability import PointMasses, TwoBetas
from rpil.search import Setting, _folds, _temperatures, _with_adversary, fit, held_out, search, starts

STEPS = (40, 60)


def setting_for(problem: Problem, mode: MStep = "joint", n_single: int = 3, annealing: int = 0) -> Setting:
    penalty = ridge(problem) / 100
    policy = SoftmaxPolicy.zero(problem.space.n, penalty)
    return Setting(policy, Share(), TwoBetas.start(), mode=mode, n_single=n_single, annealing=annealing)


def right(toy: Toy, log_odds: np.ndarray) -> bool:
    return bool(((log_odds > 0) == toy.is_good).all())


def test_starts_without_labels():
    problem = make("random", 0, steps=(5, 100)).problem()
    found = starts(problem, setting_for(problem, n_single=4), np.random.default_rng(0))
    np.testing.assert_array_equal(found["pooled"], 1.0)
    share = found["equal"] * problem.lengths
    np.testing.assert_allclose(share, share[0])
    assert (found["equal"] * problem.lengths).sum() == pytest.approx(len(problem.actions))
    singles = [weight for name, weight in found.items() if name.startswith("single")]
    assert len(singles) == 4
    assert all(sorted(weight) == [0.0] * 11 + [1.0] for weight in singles)
    assert len({int(weight.argmax()) for weight in singles}) == 4


def test_starts_with_labels_begin_from_the_known_experts_and_trust_no_known_adversary():
    problem = make("shifted", 0).labelled({2: 1, 8: -1}).problem()
    found = starts(problem, setting_for(problem), np.random.default_rng(0))
    np.testing.assert_array_equal(np.flatnonzero(found["known experts"]), [2])
    like = found["like known experts"]
    assert like[2] == 1.0
    assert like[:6].sum() > like[6:].sum()  # the others of the expert's mind, more than those of the adversary's
    assert all(weight[8] == 0.0 for weight in found.values())
    assert not any(name.startswith("single") for name in found)


def test_promising_singles_are_experts_where_these_are_few():
    """Five experts among thirty demonstrations of random actions: three picked blindly are rarely experts."""
    toy = make("random", 0, n_good=5, n_bad=25)
    problem = toy.problem()
    found = starts(problem, setting_for(problem), np.random.default_rng(0))
    singles = [int(weight.argmax()) for name, weight in found.items() if name.startswith("single")]
    assert len(singles) == 3
    assert max(singles) < 5


def test_known_adversaries_alone_point_to_those_unlike_them():
    toy = make("shifted", 1, steps=STEPS).labelled({8: -1})
    problem = toy.problem()
    unlike = starts(problem, setting_for(problem), np.random.default_rng(0))["unlike known adversaries"]
    assert set(np.flatnonzero(unlike)) <= set(range(6))
    assert unlike.sum() >= 5


def test_search_is_sorted_and_no_worse_than_the_pooled_start():
    for name, toy in zoo(1).items():
        problem = toy.problem()
        setting = setting_for(problem)
        runs = search(problem, setting, "uniform", np.random.default_rng(0))
        pooled = pooled_state(problem, "uniform", TwoBetas.start())
        alone = run(
            problem, replace(pooled, policy=SoftmaxPolicy(pooled.policy.weights, setting.policy.ridge)), max_iter=6
        )
        if not toy.labels.any():
            carried = [r.objective for r in runs[:2]]
            assert carried == sorted(carried, reverse=True), name
        assert runs[0].objective >= alone.objective - 1.0, name  # a nat: the pooled policy here is fitted to the end


def test_histories_never_fall_through_the_stages_of_a_search():
    for name, toy in zoo(2).items():
        problem = toy.problem()
        result, _ = fit(problem, setting_for(problem), ["uniform"], np.random.default_rng(0))
        assert np.diff(result.history).min(initial=0.0) >= -1e-10 * np.abs(result.history).max(), name
        log_proba = result.state.policy.log_proba(problem.features)
        again = e_step(problem, result.state, log_proba)  # the last step was an E-step: fit and predict agree
        np.testing.assert_allclose(again.log_odds, result.posterior.log_odds, atol=1e-8)


@pytest.mark.parametrize("bad", [4, 8, 10])
@pytest.mark.parametrize("which", ["uniform", "marginal", "auto"])
def test_random_actions_are_found_also_where_they_are_many(which, bad):
    toy = make("random", 0, n_good=12 - bad, n_bad=bad, steps=STEPS)
    problem = toy.problem()
    candidates = AUTO["discrete"] if which == "auto" else [which]
    result, _ = fit(problem, setting_for(problem), candidates, np.random.default_rng(0))
    assert right(toy, result.posterior.log_odds)


@pytest.mark.parametrize("n_bad", [6, 10])
@pytest.mark.parametrize("labels", ["expert", "adversary", "both"])
def test_labels_overrule_a_coherent_majority(n_bad, labels):
    """The likelihood prefers the larger group; a label knows the right one."""
    known = {"expert": {0: 1}, "adversary": {11: -1}, "both": {0: 1, 11: -1}}[labels]
    toy = make("shifted", 1, n_good=12 - n_bad, n_bad=n_bad, steps=STEPS).labelled(known)
    problem = toy.problem()
    result, _ = fit(problem, setting_for(problem), AUTO["discrete"], np.random.default_rng(0))
    assert right(toy, result.posterior.log_odds)


def test_long_bad_demonstrations_do_not_swamp_every_start():
    """Ten good ones of 20 steps, four of 240 with their actions shifted: pooled, the bad outnumber the good."""
    toy = make("shifted", 3, n_good=10, n_bad=4, steps=(20, 20))
    problem = toy.problem()
    times = np.where(toy.is_good, 1, 12)
    rows = np.concatenate([np.tile(np.arange(20) + 20 * m, times[m]) for m in range(14)])
    offsets = np.concatenate([[0], np.cumsum(20 * times)])
    swamped = Problem(problem.features[rows], problem.actions[rows], offsets, problem.space, problem.labels)
    runs = search(swamped, setting_for(swamped), "uniform", np.random.default_rng(0))
    assert any(right(toy, found.posterior.log_odds) for found in runs)


@pytest.mark.parametrize(
    ("kind", "winner", "loser"), [("flipped", "confusion", "uniform"), ("random", "uniform", "own policy")]
)
def test_held_out_likelihood_tells_adversaries_apart(kind, winner, loser):
    """Actions flipped by a minority are a confusion; random ones are not."""
    problem = make(kind, 0, n_good=8, n_bad=4 if kind == "flipped" else 8, steps=STEPS).problem()
    setting = setting_for(problem)
    folds = _folds(problem, 3, np.random.default_rng(0))
    scores = {}
    for which in (winner, loser):
        result, _ = fit(problem, setting, [which], np.random.default_rng(0))
        scores[which] = held_out(problem, setting, result, folds)
    assert scores[winner] > scores[loser]
    for candidates in ([winner, loser], [loser, winner]):
        chosen, _ = fit(problem, setting, candidates, np.random.default_rng(0))
        assert chosen.state.adversary.name == winner


def test_held_out_likelihood_is_a_little_below_that_of_the_fit():
    toy = make("random", 0, n_observations=5, steps=(10, 20))
    problem = toy.problem("poly")
    setting = setting_for(problem)
    result, _ = fit(problem, setting, ["uniform"], np.random.default_rng(0))
    score = held_out(problem, setting, result, _folds(problem, 3, np.random.default_rng(0)))
    fitted = result.posterior.log_evidence.sum()
    assert 2 * fitted < score < fitted - 10


@pytest.mark.parametrize("which", ["confusion", "normalised complement"])
def test_the_untold_know_nothing_of_a_held_out_demonstration(which):
    """Of twenty of random actions two are called experts: neither tells what the other does, but hearsay does."""
    gained: dict[str, list[float]] = {"unseen": [], "untold": []}
    for seed in range(6):
        problem = make("random", seed, n_good=0, n_bad=20, steps=(100, 100)).problem()
        problem = replace(problem, labels=np.repeat([1, -1], [2, 18]))
        setting = setting_for(problem)
        start = pooled_state(problem, which, TwoBetas.start())
        result = run(problem, start, max_iter=20)
        pair = problem.spread(problem.labels) > 0
        for learned in (unseen, untold):
            outputs = learned(problem, setting, result)[pair]
            log_pi = np.take_along_axis(outputs, problem.actions[pair, None], axis=1)
            gained[learned.__name__].append(float(log_pi.sum()) + pair.sum() * np.log(3))
    assert np.mean(gained["untold"]) < 0.0
    assert np.mean(gained["unseen"]) > np.mean(gained["untold"]) + 2.0


def test_the_untold_learn_from_the_trusted_alone():
    """Whatever demonstrations do that nobody trusts, and whatever the policy was before."""
    toy = make("random", 0)
    problem = toy.problem()
    setting = setting_for(problem)
    result = search(problem, setting, "uniform", np.random.default_rng(0))[0]
    trust = np.where(toy.is_good, 1.0, 0.0)
    joint = np.zeros_like(result.posterior.joint)
    joint[:, 0, -1], joint[:, 1, 0] = trust, 1.0 - trust
    result = replace(result, posterior=replace(result.posterior, joint=joint))
    found = untold(problem, setting, result)
    bad = problem.spread(~toy.is_good)
    other = replace(problem, actions=np.where(bad, (problem.actions + 1) % 3, problem.actions))
    zero = replace(result.state, policy=setting.policy)
    np.testing.assert_array_equal(untold(other, setting, replace(result, state=zero)), found)
    changed = replace(problem, actions=np.where(bad, problem.actions, (problem.actions + 1) % 3))
    assert np.abs(untold(changed, setting, result) - found).max() > 1.0


def test_another_adversary_starts_from_what_the_last_one_found():
    problem = make("random", 0).problem()
    result, _ = fit(problem, setting_for(problem), ["uniform"], np.random.default_rng(0))
    state = _with_adversary(problem, result, Marginal.start(3))
    counts = 1 + np.bincount(problem.actions, 1 - result.posterior.step)
    np.testing.assert_allclose(np.exp(state.adversary.log_frequency), counts / counts.sum())
    assert state.policy is result.state.policy
    assert state.reliability is result.state.reliability


def test_folds_part_the_demonstrations():
    problem = make("random", 0, n_good=3, n_bad=4).problem()
    folds = _folds(problem, 3, np.random.default_rng(0))
    assert sorted(len(fold) for fold in folds) == [2, 2, 3]
    np.testing.assert_array_equal(np.sort(np.concatenate(folds)), np.arange(7))
    assert len(_folds(make("random", 0, n_good=1, n_bad=1).problem(), 3, np.random.default_rng(0))) == 2


def test_auto_returns_one_of_its_candidates_and_the_same_for_the_same_seed():
    problem = make("noisy", 0).problem()
    first, again = (fit(problem, setting_for(problem), AUTO["discrete"], np.random.default_rng(3))[0] for _ in range(2))
    assert first.state.adversary.name in AUTO["discrete"]
    np.testing.assert_array_equal(first.posterior.log_odds, again.posterior.log_odds)
    np.testing.assert_array_equal(first.history, again.history)


def test_threads_change_no_bit(monkeypatch):
    problem = make("noisy", 0).problem()
    one, _ = fit(problem, setting_for(problem), AUTO["discrete"], np.random.default_rng(3))
    monkeypatch.setattr(parallel, "_WORTH_A_THREAD", 0)
    several, _ = fit(problem, setting_for(problem), AUTO["discrete"], np.random.default_rng(3))
    np.testing.assert_array_equal(one.posterior.log_odds, several.posterior.log_odds)
    np.testing.assert_array_equal(one.state.policy.weights, several.state.policy.weights)


def test_every_stage_is_announced():
    said: list[str] = []
    problem = make("random", 0).problem()
    fit(problem, setting_for(problem), AUTO["discrete"], np.random.default_rng(0), said.append)
    assert "start: pooled" in said
    assert {word for word in said if word.startswith("adversary")} == {
        f"adversary: {name}" for name in AUTO["discrete"]
    }


def test_annealing_warms_from_one_steps_worth_to_all():
    problem = make("random", 0, steps=(50, 50)).problem()
    assert len(_temperatures(problem, 0)) == 0
    betas = _temperatures(problem, 4)
    assert betas[0] == pytest.approx(1 / 50)
    assert len(betas) == 4
    assert (np.diff(betas) > 0).all()
    assert betas[-1] < 1
    result, _ = fit(problem, setting_for(problem, annealing=4), ["uniform"], np.random.default_rng(0))
    assert right(make("random", 0, steps=(50, 50)), result.posterior.log_odds)


def test_an_adversary_may_be_an_instance():
    problem = make("random", 0).problem()
    result, _ = fit(problem, setting_for(problem), [Uniform()], np.random.default_rng(0))
    assert isinstance(result.state.adversary, Uniform)


def test_the_papers_mixture_fails_where_half_the_actions_are_random_and_reliabilities_do_not():
    """model.md: "partly bad demonstrations"; the reason for the two-level model."""
    toy = make("noisy", 1, n_actions=4, steps=STEPS)
    problem = toy.problem()
    setting = setting_for(problem)
    result, _ = fit(problem, setting, ["uniform"], np.random.default_rng(0))
    assert right(toy, result.posterior.log_odds)
    papers = replace(setting, reliability=PointMasses(), n_single=0)  # and its start, the pooled fit
    paper, _ = fit(problem, papers, ["uniform"], np.random.default_rng(0))
    assert (paper.posterior.log_odds[~toy.is_good] > 0).any()


def test_where_nobody_agrees_the_first_solution_stands_and_the_likelier_of_two_that_trust_the_same(monkeypatch):
    def solution(objective, *expert):
        posterior = SimpleNamespace(expert=np.array(expert))
        return SimpleNamespace(objective=objective, posterior=posterior, state=SimpleNamespace(adversary=None))

    runs = [solution(3.0, 0.9, 0.1), solution(1.0, 0.2, 0.8), solution(4.0, 0.8, 0.3), solution(9.0, 0.9, 0.9)]
    monkeypatch.setattr(search_module, "agreement", lambda *_: 0.0)
    monkeypatch.setattr(search_module, "_contradicted", lambda *_: 0)
    monkeypatch.setattr(search_module, "_from", lambda *_: solution(99.0, 0.1, 0.1))
    monkeypatch.setattr(search_module, "_continue", lambda problem, setting, result: result)
    setting = SimpleNamespace(policy=None)
    assert search_module._who_agrees(None, setting, runs, np.random.default_rng(0)) is runs[2]
