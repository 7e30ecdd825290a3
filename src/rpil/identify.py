"""What cannot be known: several groups of demonstrations, each of one mind, and nothing that says which is the expert.

Noise agrees with nobody, so a mixture finds the experts by their agreement. Adversaries who agree among themselves look
exactly like experts. Two groups compete when each predicts its own held-out members, and one policy for both predicts
much less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rpil.agreement import predictable
from rpil.em import Result
from rpil.passes import Array
from rpil.problem import Problem
from rpil.search import Setting, search

_RIVALRY = 0.2
"""A group competes when so large a share of the predictable is lost to a policy that the other group teaches as well.

Over simulated corruptions the share is .13 at most for incoherent ones and for parts of one group, .28 at least (mostly
.8) for coherent ones.
"""

_MAX_GROUPS = 5
_MAX_PARTS = 2


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
    for group in [experts, *parts[:_MAX_PARTS]]:
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
        others = problem.select(rest, unlabelled=True)
        found = search(others, replace(setting, n_single=1), "marginal", rng, carried=0)[0]
        rival = rest[found.posterior.expert > 0.5]
        if len(rival) < 2 or not all(_compete(problem, setting, group, rival, rng) for group in groups):
            break
        groups.append(rival)
        rest = np.setdiff1d(rest, rival)
    return groups


def _compete(problem: Problem, setting: Setting, one: Array, other: Array, rng: np.random.Generator) -> bool:
    """Whether much of what is predictable in either group is lost when both teach."""
    own, lost = zip(
        *(predictable(problem, setting.policy, *pair, rng) for pair in ((one, other), (other, one))), strict=True
    )
    return min(lost) > _RIVALRY * max(own) > 0.0
