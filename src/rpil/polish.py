"""Fits to all demonstrations, wherever they lie, from what a sample of them found: every iteration is one pass.

A pass is an E-step at some parameters and, with the responsibilities that it gives, the sums from which every part of
the state improves; so the E-step costs no reading of its own. By Fisher's identity these are the gradients of the
observed-data likelihood itself ("One optimisation instead of two loops" in docs/model.md). Policies take Newton steps
with the Hessian of the sample, scaled up: a sample of fifty steps a coefficient gets most directions right, so that
each pass takes most of the error away.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from typing import Any

import numpy as np

from rpil.em import MStep, Posterior, State, e_step
from rpil.engines import Shards
from rpil.passes import Array, Sums, add
from rpil.problem import Problem

_ROUNDING = 1e-8
"""Share of the objective that a pass may lose to rounding: some 3e-9, with a few thousand steps in single precision."""

_SHORTEST = 1 / 64
"""Of a step, before the search along it is given up."""

_PATIENCE = 10
"""Passes in which the gradient must halve, or rounding is all that is left of it."""

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Polished:
    """Where passes over everything ended: a `State`, or a policy."""

    state: Any
    history: Array = field(default_factory=lambda: np.empty(0))
    converged: bool = False


def primed(state: State, sample: Problem, posterior: Posterior, mode: MStep, ridge: Array, factor: float) -> State:
    """`state`, found on a sample, ready for sums over `factor` times as many steps; `ridge` is for all of them."""
    expert, adversary = posterior.step, 1 - posterior.step
    teaches = mode == "joint" and state.adversary.intended(posterior.outputs[:1], sample.actions[:1]) is not None
    policy: Any = state.policy
    return replace(
        state,
        policy=policy.primed(sample, expert + adversary if teaches else expert, ridge, factor),
        adversary=state.adversary.primed(sample, adversary, ridge, factor),
    )


def resumed(state: State, start: State) -> State:
    """`state`, from a checkpoint, ready for the same sums as `start`, with which the passes began."""
    policy: Any = state.policy
    return replace(state, policy=policy.like(start.policy), adversary=state.adversary.like(start.adversary))


def em_pass(problem: Problem, state: State, mode: MStep) -> Sums:
    """Log-evidence and what every part of `state` must know to improve, summed over some demonstrations."""
    policy: Any = state.policy
    posterior = e_step(problem, state, policy.outputs(problem.features))
    return (
        posterior.log_evidence.sum(),
        policy.statistics(problem, posterior.outputs, posterior.step, lesson_of(problem, state, posterior, mode)),
        state.adversary.statistics(problem, posterior.outputs, 1 - posterior.step),
        state.prior.statistics(posterior.expert, problem.lengths),
        posterior.joint.sum(axis=0),
    )


def lesson_of(problem: Problem, state: State, posterior: Posterior, mode: MStep) -> Array | None:
    """What the adversary's steps teach the policy, (N, K), see `rpil.policies.Policy.learn`."""
    intended = state.adversary.intended(posterior.outputs, problem.actions) if mode == "joint" else None
    return None if intended is None else (1 - posterior.step)[:, None] * intended


def improved(state: State, sums: Sums) -> State:
    """Every part one step better, given the sums over everything."""
    _, policy, adversary, prior, counts = sums
    mine: Any = state.policy
    return replace(
        state,
        policy=mine.improved(policy),
        adversary=state.adversary.improved(adversary),
        prior=state.prior.improved(prior),
        reliability=state.reliability.fit(counts),
    )


def polish(
    shards: Shards,
    start: Polished,
    mode: MStep,
    n_demonstrations: int,
    tol: float,
    max_iter: int,
    progress: Progress = lambda _: None,
    keep: Callable[[Polished], None] = lambda _: None,
) -> Polished:
    """EM on everything from a `primed` state, until the objective gains less than `tol` nats a demonstration.

    `keep` is called after every pass with what there is; it is a `start` from which the same bits follow.
    """

    def towards(before: State, after: State, share: float) -> State:
        policy: Any = before.policy
        return replace(after, policy=policy.towards(after.policy, share))

    def measure(at: State) -> tuple[float, Sums]:
        sums = total(shards, partial(em_pass, state=at, mode=mode))
        own = at.prior.log_prior() + at.reliability.log_prior() + at.adversary.log_prior() - at.policy.penalty()
        return float(sums[0]) + own, sums

    return _climb(start, measure, improved, towards, tol * n_demonstrations, max_iter, progress, keep)


def clone_pass(lesson: tuple[Problem, Array, Array], policy: Any) -> Sums:
    """Log-likelihood and weight of weighted steps, and what the policy must know to improve."""
    problem, weight, _ = lesson
    log_prob, statistics = policy.study(problem, weight)
    return weight @ log_prob, statistics, weight.sum()


def clone(shards: Shards, policy: Any, tol: float, max_iter: int, progress: Progress = lambda _: None) -> Polished:
    """A `primed` policy, fitted to weighted steps until no entry of the gradient is above `tol` a step."""

    def measure(at: Any) -> tuple[float, Sums]:
        sums = total(shards, partial(clone_pass, policy=at))
        return float(sums[0]) - at.penalty(), sums

    slopes: list[float] = []

    def better(at: Any, sums: Sums) -> Any:
        slopes.append(at.slope(sums[1]))
        stuck = len(slopes) > _PATIENCE and min(slopes[-_PATIENCE:]) > 0.5 * min(slopes[:-_PATIENCE])
        return at if stuck or slopes[-1] <= tol * sums[2] else at.improved(sums[1])

    def towards(before: Any, after: Any, share: float) -> Any:
        return before.towards(after, share)

    return _climb(Polished(policy), measure, better, towards, -np.inf, max_iter, progress)


def total(shards: Shards, one_pass: Callable[[Any], Sums]) -> Sums:
    """The sums over all shards, always added up in the same order."""
    return reduce(add, shards.map(one_pass))


def _climb(
    start: Polished,
    measure: Callable[[Any], tuple[float, Sums]],
    better: Callable[[Any, Sums], Any],
    towards: Callable[[Any, Any, float], Any],
    goal: float,
    max_iter: int,
    progress: Progress,
    keep: Callable[[Polished], None] = lambda _: None,
) -> Polished:
    """Steps uphill until one gains no more than `goal`, or `better` knows none.

    One that went down is shortened, as the Hessian of a sample may be too small somewhere.
    """
    begun = time.perf_counter()
    here, history = start.state, start.history
    value, sums = measure(here)
    history = history if len(history) else np.array([value])
    n_before = len(history)
    while len(history) <= max_iter and not start.converged:
        elapsed = (time.perf_counter() - begun) / (1 + len(history) - n_before)
        progress(f"pass {len(history)} over everything, objective {value:.6g}{_time_left(history, goal, elapsed)}")
        far = there = better(here, sums)
        if there is here:
            return Polished(here, history, True)
        share = 1.0
        new_value, new_sums = measure(there)
        while new_value < value - _ROUNDING * abs(value):
            share *= 0.25
            if share < _SHORTEST:
                return Polished(here, history, False)
            there = towards(here, far, share)
            new_value, new_sums = measure(there)
        gain = new_value - value
        here, value, sums = there, new_value, new_sums
        history = np.append(history, value)
        converged = gain <= goal
        keep(Polished(here, history, converged))
        if converged:
            return Polished(here, history, True)
    return Polished(here, history, start.converged)


def _time_left(history: Array, goal: float, seconds: float) -> str:
    """In words, as far as two gains tell how fast they shrink."""
    gains = np.diff(history[-3:])
    if len(gains) < 2 or not 0.0 < gains[1] < gains[0] or not 0.0 < goal < gains[1]:
        return ""
    passes = np.ceil(np.log(gains[1] / goal) / np.log(gains[0] / gains[1]))
    return f", about {passes * seconds:.0f} s left"
