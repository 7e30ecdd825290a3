"""What cannot be known: several groups of demonstrations, each of one mind, and nothing that says which is the expert.

Noise agrees with nobody, so a mixture finds the experts by their agreement. Adversaries who agree among themselves look
exactly like experts. Two groups compete when each predicts its own held-out members, and most of what it predicts is
beyond the other group's policy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rpil.em import Problem, Result, evidence_by_reliability
from rpil.passes import Array
from rpil.search import Setting, search

_RIVALRY = 0.5
"""A group competes when so large a share of the predictable is predictable from its own members only.

Over simulated corruptions the share is .3 at most for incoherent ones and .5 at least (mostly .8) for coherent ones.
"""

_MAX_GROUPS = 5
_RHO = np.linspace(0.0, 1.0, 21)


def competing_groups(
    problem: Problem, setting: Setting, result: Result, runs: Sequence[Result], rng: np.random.Generator
) -> list[Array]:
    """Groups of demonstrations (their indices) that compete for being the expert; empty where none does.

    A policy can also blend two groups into one. Its parts are then what other starts (`runs`) found among its experts.
    Labels settle it: a known expert, or a known adversary in every group but one.
    """
    if (problem.labels > 0).any():
        return []
    experts = _experts(result)
    parts = [part for part in map(_experts, runs) if len(part) < 0.9 * len(experts) and np.isin(part, experts).all()]
    seen: set[bytes] = set()
    for group in [experts, *parts]:
        if len(group) < 2 or group.tobytes() in seen:
            continue
        seen.add(group.tobytes())
        groups = _with_rivals(problem, setting, group, rng)
        open_to = [other for other in groups if not (problem.labels[other] < 0).any()]
        if len(open_to) > 1:
            return open_to
    return []


def _experts(result: Result) -> Array:
    return np.flatnonzero(result.posterior.expert > 0.5)


def _with_rivals(problem: Problem, setting: Setting, experts: Array, rng: np.random.Generator) -> list[Array]:
    """`experts` and the groups found one after the other among the rest."""
    groups = [experts]
    rest = np.setdiff1d(np.arange(problem.n_demonstrations), experts)
    while len(rest) >= 2 and len(groups) < _MAX_GROUPS:
        found = search(problem.select(rest, unlabelled=True), replace(setting, n_single=1), "marginal", rng)[0]
        rival = rest[found.posterior.expert > 0.5]
        if len(rival) < 2 or not all(_compete(problem, setting, group, rival, rng) for group in groups):
            break
        groups.append(rival)
        rest = np.setdiff1d(rest, rival)
    return groups


def _compete(problem: Problem, setting: Setting, one: Array, other: Array, rng: np.random.Generator) -> bool:
    """Whether most of what is predictable in either group is so from its own members only."""
    own, beyond = zip(
        *(_predictable(problem, setting, *pair, rng) for pair in ((one, other), (other, one))), strict=True
    )
    return min(beyond) > _RIVALRY * max(own) > 0.0


def _predictable(
    problem: Problem, setting: Setting, group: Array, other: Array, rng: np.random.Generator
) -> tuple[float, float]:
    """Medians over the demonstrations of `group`, in nats a step over the group's action frequencies: what the other
    members predict, and how much of it the `other` group does not."""
    mine = problem.select(group)
    frequency = 1.0 + np.bincount(mine.actions, minlength=problem.n_actions)
    guess = np.log(frequency / frequency.sum())
    own = np.zeros(len(group))
    order = rng.permutation(len(group))
    n_folds = min(3, len(group))
    for k in range(n_folds):
        held = np.sort(order[k::n_folds])
        own[held] = _gain(problem, setting, np.delete(group, held), group[held], guess)
    return float(np.median(own)), float(np.median(own - _gain(problem, setting, other, group, guess)))


def _gain(problem: Problem, setting: Setting, teachers: Array, pupils: Array, guess: Array) -> Array:
    """Nats a step, for each of `pupils`, by which the policy of `teachers`, trusted as far as is best for this
    demonstration, predicts better than the frequencies ``exp(guess)``."""
    taught, asked = problem.select(teachers), problem.select(pupils)
    targets = taught.one_hot(np.ones(len(taught.actions)))
    policy, _ = setting.policy.fit(taught.features, targets, tol=1e-3, max_iter=20, max_cg=20)
    log_pi = asked.taken(policy.log_proba(asked.features))
    log_guess = guess[asked.actions]
    evidence = evidence_by_reliability(asked, log_pi, log_guess, _RHO)
    return (evidence.max(axis=1) - asked.sum_steps(log_guess)) / asked.lengths
