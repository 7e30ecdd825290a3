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

_N_FOLDS = 3
_N_REPEATS = 4
_RHO = np.linspace(0.0, 1.0, 21)


def predictable(
    problem: Problem, policy: Policy, group: Array, other: Array, rng: np.random.Generator
) -> tuple[float, float]:
    """Medians over the demonstrations of `group`, in nats a step over the group's action frequencies: what the other
    members predict, and how much of it is lost when the `other` group teaches as well, with the same weight."""
    guess = marginal(problem.select(group), policy)
    alone, together = np.zeros((2, len(group)))
    for held in _folds(len(group), rng):
        rest = np.delete(group, held)
        alone[held] = _gain(problem, policy, [rest], group[held], guess)
        together[held] = _gain(problem, policy, [rest, other], group[held], guess)
    return float(np.median(alone)), float(np.median(alone - together))


def agreement(problem: Problem, policy: Policy, group: Array, rng: np.random.Generator) -> float:
    """How much the members of a group agree: G^2 / N, where G is what they predict of each other, in nats over what is
    frequent among all, and N is their steps.

    That is the scan statistic for a mean above zero (Kulldorff 1997, with Gaussian noise): few who agree perfectly are
    as remarkable as many who agree somewhat. G is a mean over several ways of holding out: where two alone are of one
    kind, it matters whether they are held out together.
    """
    if len(group) < 2:
        return 0.0
    guess = marginal(problem, policy)
    gain, steps = 0.0, problem.lengths[group]
    for held in (fold for _ in range(_N_REPEATS) for fold in _folds(len(group), rng)):
        each = _gain(problem, policy, [np.delete(group, held)], group[held], guess)
        gain += float(each @ steps[held]) / _N_REPEATS
    return max(gain, 0.0) ** 2 / float(steps.sum())


def _folds(n: int, rng: np.random.Generator) -> list[Array]:
    order = rng.permutation(n)
    return [np.sort(order[k::_N_FOLDS]) for k in range(min(_N_FOLDS, n))]


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
