"""What policies say of demonstrations that they did not see, or hardly."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rpil.em import Result
from rpil.passes import Array
from rpil.problem import Problem
from rpil.search import Setting, taught_by, without

_N_FOLDS = 5

_OWN_SAY = {"discrete": 0.0, "continuous": 0.05}
"""Weight of a demonstration in the policy that it is judged by, by kind of actions: next to nothing where others have
been, and all there is where nobody else has. There a mean can be off by any amount, and would condemn an expert."""


def unseen(problem: Problem, setting: Setting, result: Result) -> Array:
    """Outputs, (N, ...), of policies that are fitted as `result`'s but to the other folds of demonstrations, who have
    their own say beside them, see `_OWN_SAY`.

    Demonstrations are dealt out by length, so that folds are alike, and do not depend on their order.
    """
    outputs = np.array(result.posterior.outputs)
    own_say = _OWN_SAY[problem.space.kind]
    weight = np.ones(len(problem.actions)) if problem.weight is None else problem.weight
    for fold, steps in _dealt(problem):
        if own_say:
            whispering = replace(problem, weight=np.where(steps, own_say * weight, weight))
            state = taught_by(whispering, setting, result)
        else:
            state = without(problem, setting, result, fold)
        outputs[steps] = state.policy.outputs(problem.features[steps])
    return outputs


def untold(problem: Problem, setting: Setting, result: Result) -> Array:
    """Outputs, (N, ...), of policies that know nothing of a demonstration, not even by hearsay.

    What adversaries meant to do teaches the policy too, and so do those of their steps that might be the expert's; both
    are guessed by a policy which has seen everybody. Where most are adversaries these guesses outweigh what experts
    did, and `unseen` hardly forgets: so it finds that demonstrations which are alike by chance predict each other. Here
    only the trusted teach, as far as they are trusted, and from the beginning.
    """
    outputs = np.array(result.posterior.outputs)
    for fold, steps in _dealt(problem):
        trust = result.posterior.expert.copy()
        trust[fold] = 0.0
        teaches = problem.spread(trust) * result.posterior.step * (1.0 if problem.weight is None else problem.weight)
        _, learned = setting.policy.learn(problem, teaches, tol=1e-3, max_iter=20, max_cg=20)
        outputs[steps] = learned[steps]
    return outputs


def cross_fitted(problem: Problem, setting: Setting, result: Result) -> tuple[Array, Array | None]:
    """Outputs of the `unseen` and of the `untold`; no latter where adversaries teach nothing that could be told."""
    outputs = unseen(problem, setting, result)
    lesson = result.state.adversary.intended(result.posterior.outputs[:1], problem.actions[:1])
    teaches = setting.mode == "joint" and lesson is not None
    return outputs, untold(problem, setting, result) if teaches else None


def _dealt(problem: Problem) -> Iterator[tuple[Array, Array]]:
    """Demonstrations to predict together, and which steps are theirs, (N,) bool."""
    order = np.argsort(problem.lengths, kind="stable")
    for k in range(min(_N_FOLDS, len(order))):
        fold = np.sort(order[k::_N_FOLDS])
        yield fold, problem.spread(np.isin(np.arange(problem.n_demonstrations), fold))
