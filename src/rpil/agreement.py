"""Whether the members of a group agree: how much of what one does the others predict.

Experts agree with one another; that is what the whole model stands on. Demonstrations are compared with each other by
policies that did not see them, and with what is frequent in any state, since who does little is easy to predict.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rpil.adversaries import Adversary, marginal
from rpil.em import evidence_by_reliability
from rpil.passes import Array
from rpil.policies import Policy
from rpil.problem import Problem

_RHO = np.linspace(0.0, 1.0, 21)


def predictable(
    problem: Problem, policy: Policy, group: Array, other: Array, rng: np.random.Generator
) -> tuple[float, float]:
    """Medians over the demonstrations of `group`, in nats a step over the group's action frequencies: what the other
    members predict, and how much of it is lost when the `other` group teaches as well, with the same weight."""
    mine = problem.select(group)
    guess = marginal(mine, policy)
    alone, together = np.zeros((2, len(group)))
    order = rng.permutation(len(group))
    n_folds = min(3, len(group))
    for k in range(n_folds):
        held = np.sort(order[k::n_folds])
        rest = np.delete(group, held)
        alone[held] = _gain(problem, policy, [rest], group[held], guess)
        together[held] = _gain(problem, policy, [rest, other], group[held], guess)
    return float(np.median(alone)), float(np.median(alone - together))


def _gain(problem: Problem, policy: Policy, schools: Sequence[Array], pupils: Array, guess: Adversary) -> Array:
    """Nats a step, for each of `pupils`, by which the policy that `schools` of equal weight teach, trusted as far as is
    best for this demonstration, predicts better than `guess`, which knows what is frequent."""
    taught, asked = problem.select(np.concatenate(schools)), problem.select(pupils)
    weight = np.concatenate([np.full(len(school), 1 / problem.lengths[school].sum()) for school in schools])
    attention = taught.spread(weight * len(taught.actions) / len(schools))
    policy, _ = policy.learn(taught, attention, tol=3e-3, max_iter=10, max_cg=10)
    outputs = policy.outputs(asked.features)
    log_pi = policy.log_prob(outputs, asked.actions)
    log_guess = guess.log_prob(asked.features, outputs, asked.actions)
    evidence = evidence_by_reliability(asked, log_pi, log_guess, _RHO)
    return (evidence.max(axis=1) - asked.sum_steps(log_guess)) / asked.lengths
