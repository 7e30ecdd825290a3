"""Sticky steps against the sum over every assignment of steps, and what they are for."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit

from problems import Toy, make, pooled_state, ridge, zoo
from rpil import chains, search
from rpil.em import e_step, evidence_by_reliability, expert_steps, run
from rpil.policies import SoftmaxPolicy
from rpil.priors import Share
from rpil.problem import Problem
from rpil.reliability import PointMasses, TwoBetas
from rpil.search import Setting, fit

OFFSETS = np.array([0, 1, 4, 10, 12])
NODES = np.array([0.0, 1e-3, 0.3, 0.8, 1.0])


def steps(seed: int = 0, offsets: np.ndarray = OFFSETS) -> tuple[np.ndarray, np.ndarray]:
    """log pi and log psi of made-up steps."""
    log_pi, log_psi = np.log(np.random.default_rng(seed).random((2, offsets[-1])))
    return log_pi, log_psi


def enumerated(log_pi: np.ndarray, log_psi: np.ndarray, rho: float, s: float) -> tuple[float, np.ndarray]:
    """Likelihood of a demonstration and the posterior of its steps, every assignment on its own."""
    total, mine = 0.0, np.zeros(len(log_pi))
    for who in itertools.product((0, 1), repeat=len(log_pi)):
        drawn = [rho if k else 1 - rho for k in who]
        path = drawn[0]
        for n in range(1, len(who)):
            path *= s * (who[n] == who[n - 1]) + (1 - s) * drawn[n]
        path *= np.exp(np.where(who, log_pi, log_psi).sum())
        total += path
        mine += path * np.array(who)
    return total, mine / total


@pytest.mark.parametrize("s", [0.1, 0.5, 0.95])
@pytest.mark.parametrize("entries", [1, 40, 1 << 18])
def test_against_every_assignment(monkeypatch, entries, s):
    monkeypatch.setattr(chains, "_ENTRIES", entries)
    log_pi, log_psi = steps()
    by_node = np.random.default_rng(1).dirichlet(np.ones(len(NODES)), len(OFFSETS) - 1)
    evidence = chains.log_evidence(log_pi, log_psi, OFFSETS, NODES, s)
    found = chains.expert_steps(log_pi - log_psi, OFFSETS, by_node, NODES, s)
    for m in range(len(OFFSETS) - 1):
        mine = slice(OFFSETS[m], OFFSETS[m + 1])
        each = [enumerated(log_pi[mine], log_psi[mine], rho, s) for rho in NODES]
        np.testing.assert_allclose(evidence[m], [np.log(total) for total, _ in each], atol=1e-11)
        np.testing.assert_allclose(found[mine], by_node[m] @ np.stack([mean for _, mean in each]), atol=1e-11)


def test_barely_sticky_steps_are_independent_ones():
    offsets = np.array([0, 50, 51, 120])
    log_pi, log_psi = steps(2, offsets)
    nodes = TwoBetas.start().nodes
    by_node = np.random.default_rng(0).dirichlet(np.ones(len(nodes)), 3)
    problem = Problem(np.ones((120, 1)), np.zeros(120, int), offsets, 2, np.zeros(3, int))
    for function, arguments in (
        (evidence_by_reliability, (log_pi, log_psi, nodes)),
        (expert_steps, (log_pi - log_psi, by_node, nodes)),
    ):
        sticky = function(problem, *arguments, stickiness=1e-12)
        np.testing.assert_allclose(sticky, function(problem, *arguments), atol=1e-8)


@pytest.mark.parametrize("size", [5.0, 2000.0])
def test_long_demonstrations_neither_under_nor_overflow(size):
    """And there, runs are seen: the first half is the expert's, the second is not."""
    n_steps = 10_000
    log_pi = np.where(np.arange(n_steps) < n_steps / 2, -0.1, -size)
    log_psi = np.where(np.arange(n_steps) < n_steps / 2, -size, -0.1)
    nodes, offsets = np.r_[0.0, TwoBetas.start().nodes, 1.0], np.array([0, n_steps])
    evidence = chains.log_evidence(log_pi, log_psi, offsets, nodes, 0.95)
    assert np.isfinite(evidence).all()
    assert evidence[0, -1] == pytest.approx(log_pi.sum())
    assert evidence[0, 0] == pytest.approx(log_psi.sum())
    found = chains.expert_steps(log_pi - log_psi, offsets, np.full((1, 34), 1 / 34)[:, 1:-1], nodes[1:-1], 0.95)
    assert found[: n_steps // 2 - 50].min() > 0.9  # of 32 / 34
    assert found[n_steps // 2 + 50 :].max() < 0.05


@pytest.mark.parametrize("which", ["uniform", "complement", "confusion"])
def test_the_objective_never_falls(which):
    for name, toy in zoo(0).items():
        problem = toy.problem()
        for weight in (None, np.random.default_rng(0).gamma(1.0, size=len(toy.actions))):
            state = replace(pooled_state(problem, which, TwoBetas.start()), stickiness=0.8)
            history = run(replace(problem, weight=weight), state, max_iter=8, tol=0.0).history
            assert np.isfinite(history).all(), name
            assert np.diff(history).min() >= -1e-10 * np.abs(history).max(), name


def test_whole_demonstrations_know_no_runs():
    problem = make("window", 0).problem()
    state = pooled_state(problem, "uniform", PointMasses())
    log_proba = state.policy.log_proba(problem.features)
    independent, sticky = (e_step(problem, replace(state, stickiness=s), log_proba) for s in (0.0, 0.5))
    np.testing.assert_allclose(sticky.log_odds, independent.log_odds)
    np.testing.assert_allclose(sticky.step, independent.step)


def windows(seed: int, n_good: int = 5, n_bad: int = 70, n_steps: int = 60) -> Toy:
    """Half of the steps in a row are random, the middle of a demonstration most often: a policy that is random there
    is liked by an independent mixture."""
    rng = np.random.default_rng(seed)
    n = n_good + n_bad
    when = np.tile((np.arange(n_steps) + 0.5) / n_steps, n)
    side = rng.normal(size=n * n_steps)
    side += 0.2 * np.sign(side)
    actions = (rng.random(len(side)) < expit(5 * side)).astype(int)
    for m in range(n_good, n):
        start = m * n_steps + rng.integers(n_steps // 2 + 1)
        actions[start : start + n_steps // 2] = rng.integers(2, size=n_steps // 2)
    observations = np.stack([side, side * np.minimum(1.0, 2 * np.minimum(when, 1 - when))], axis=1)
    offsets = np.arange(n + 1) * n_steps
    return Toy(observations, actions, offsets, 2, np.arange(n) < n_good, np.zeros(n, dtype=int), np.zeros((3, 2)))


def test_windows_that_an_independent_mixture_takes_for_the_expert():
    toy = windows(3)
    problem = toy.problem()
    penalty = ridge(problem) / 100
    setting = Setting(SoftmaxPolicy.zero(2, penalty), penalty, Share(), TwoBetas.start())
    independent = search.search(problem, setting, "uniform", np.random.default_rng(0))[0]
    found, runs = fit(problem, setting, ["uniform"], np.random.default_rng(0))
    assert ((independent.posterior.log_odds > 0) != toy.is_good).sum() > 10
    assert independent.objective > found.objective  # the likelihood itself is wrong, not the search
    np.testing.assert_array_equal(found.posterior.log_odds > 0, toy.is_good)
    assert found.state.stickiness == 0.0
    assert runs[1].objective == independent.objective


def test_independent_noise_changes_nothing():
    """Not one bit: the search for runs is not even begun."""
    problem = make("noisy", 0, n_good=8, steps=(40, 60)).problem()
    setting = Setting(SoftmaxPolicy.zero(3, ridge(problem)), ridge(problem), Share(), TwoBetas.start())
    said: list[str] = []
    fit(problem, setting, ["uniform"], np.random.default_rng(0), said.append)
    assert "bad steps in runs" not in said
