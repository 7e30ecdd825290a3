"""Choosing what a policy sees, and how smooth it is, by demonstrations that were held out.

Every kind of features is cross-fitted over demonstrations, each with as much say as it is trusted: bad demonstrations
do not choose. The kind is chosen by likelihood: the median's over demonstrations, because a single one that went
where no other did decides every mean; and at the best temperature, because a policy acts by its most likely action,
which being too sure does not change. The ridge is chosen by that action: the weakest one that hits as many held-out
actions as the best, up to a standard error. A strong ridge makes likelihoods safe and decisions flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from rpil.features import KINDS, RIDGE_PER_STEP, FeatureMap
from rpil.inputs import ridge_of
from rpil.passes import Array, log_softmax
from rpil.policies import linear_policy
from rpil.problem import Problem
from rpil.spaces import Space

RIDGES = (1e-2, 1e-3, 1e-4, 1e-5)
"""Penalties a step, from strong to weak: each fit starts from the one before."""

_N_FOLDS = 5
_MOST_STEPS = 6_000
_MOST_COLUMNS = 450
_TEMPERATURES = (np.log(0.03), np.log(5.0))


@dataclass(frozen=True)
class Choice:
    """Features, and what goes with them.

    Attributes
    ----------
    kind : str
        One of `rpil.features.KINDS`.
    ridge : float
        Penalty a step.
    temperature : float
        What logits are multiplied by to be as sure as held-out demonstrations allow.
    """

    kind: str
    ridge: float = RIDGE_PER_STEP
    temperature: float = 1.0


@dataclass(frozen=True, eq=False)
class _Held:
    """What demonstrations that are held out say of a choice: its `value` as a kind of features, and how accurate it is
    on each of them, (M,)."""

    choice: Choice
    value: float
    accuracy: Array


def choose(
    observations: NDArray[Any], codes: Array, offsets: Array, weight: Array, space: Space, C: float | None = None
) -> Choice:
    """The features under which held-out demonstrations are most likely.

    Parameters
    ----------
    observations : (N, D) array
    codes : (N,) int array, or (N, A) array
        Actions, 0 .. K-1, or numbers.
    offsets : (M + 1,) int array
        Demonstration m owns the steps ``offsets[m]:offsets[m + 1]``.
    weight : (N,) array
        Trust in each step.
    space : Space
        Of the actions.
    C : float, optional
        Inverse ridge strength of scikit-learn, where it is given and not to be chosen.
    """
    ridges = RIDGES if C is None else (RIDGE_PER_STEP,)
    steps, demonstration, fold = _sample(offsets, weight)
    observations, codes, weight = observations[steps], codes[steps], weight[steps]
    trust = np.bincount(demonstration, weight) / np.bincount(demonstration)
    found: list[_Held] = []
    for kind in KINDS:
        if _n_columns(kind, observations.shape[1]) > _MOST_COLUMNS:
            continue
        outputs = _held_out(kind, observations, codes, weight, fold, space, ridges, C)
        found += [
            _JUDGES[space.kind](Choice(kind, ridge), space.bounded(said), codes, weight, demonstration)
            for ridge, said in zip(ridges, outputs, strict=True)
        ]
    kind = max(found, key=lambda held: held.value).choice.kind
    alike = [held for held in found if held.choice.kind == kind]
    best = max(alike, key=lambda held: float(np.average(held.accuracy, weights=trust)))
    return min((held.choice for held in alike if _as_good(held, best, trust)), key=lambda choice: choice.ridge)


def _sample(offsets: Array, weight: Array) -> tuple[Array, Array, Array]:
    """Steps to choose by, the demonstration of each, 0, 1 .., and its fold: whole demonstrations of some weight."""
    rng = np.random.default_rng(0)
    lengths = np.diff(offsets)
    trust = np.add.reduceat(weight, offsets[:-1]) / lengths
    order = rng.permutation(np.flatnonzero(trust > 0.1 * trust.max()))
    enough = int(np.searchsorted(np.cumsum(lengths[order]), _MOST_STEPS)) + 1
    kept = order[: max(enough, 2)]
    steps = np.concatenate([np.arange(offsets[m], offsets[m + 1]) for m in kept])
    demonstration = np.repeat(np.arange(len(kept)), lengths[kept])
    if len(kept) == 1:  # parts of the only demonstration stand for demonstrations
        demonstration = np.arange(len(steps)) * min(_N_FOLDS, len(steps)) // len(steps)
    return steps, demonstration, demonstration % _N_FOLDS


def _n_columns(kind: str, n_observations: int) -> int:
    """About how many columns a kind has."""
    return {
        "raw": n_observations,
        "folded": 2 * n_observations,
        "spline": 10 * n_observations,
        "poly": n_observations * (n_observations + 3) // 2,
        "nystroem": 2 * n_observations + 200,
    }[kind]


def _held_out(
    kind: str,
    observations: Array,
    codes: Array,
    weight: Array,
    fold: Array,
    space: Space,
    ridges: Sequence[float],
    C: float | None,
) -> Array:
    """Outputs for each ridge, by policies that did not see the fold of the step, (R, N, ...)."""
    features = FeatureMap.fit(kind, observations, weight)
    design = features.design(observations, single=True)
    out: list[list[Array]] = [[] for _ in ridges]
    order = np.argsort(fold, kind="stable")
    for held in np.unique(fold):
        test, train = fold == held, fold != held
        taught, asked, trust = Problem.of_steps(design[train], codes[train], space), design[test], weight[train]
        policy: Any = None
        for r, ridge in enumerate(ridges):
            penalty = ridge_of(replace(features, ridge_per_step=ridge), C, trust.sum(), space)
            zero: Any = linear_policy(space, penalty, trust.sum())
            start = zero if policy is None else replace(zero, weights=policy.weights)
            policy, _ = start.learn(taught, trust, tol=1e-3, max_iter=20, max_cg=30)
            out[r].append(policy.outputs(asked))
    return np.stack([np.concatenate(parts)[np.argsort(order, kind="stable")] for parts in out])


def _judge(choice: Choice, log_proba: Array, codes: Array, weight: Array, demonstration: Array) -> _Held:
    total = np.bincount(demonstration, weight)
    share, trust = weight / total[demonstration], total / np.bincount(demonstration)

    def likelihood(log_temperature: float) -> Array:
        log_pi = log_softmax(np.exp(log_temperature) * log_proba)
        return np.bincount(demonstration, share * np.take_along_axis(log_pi, codes[:, None], axis=1)[:, 0])

    found = minimize_scalar(
        lambda t: -_median(likelihood(t), trust), bounds=_TEMPERATURES, method="bounded", options={"xatol": 0.02}
    )
    hit = np.bincount(demonstration, share * (log_proba.argmax(axis=1) == codes))
    return _Held(replace(choice, temperature=float(np.exp(found.x))), -float(found.fun), hit)


def _judge_numbers(choice: Choice, mean: Array, actions: Array, weight: Array, demonstration: Array) -> _Held:
    """Both by the squared error within the box, of each part in units of its variance: no single demonstration can
    make that infinite, so the mean decides; the likelihood of a heavy-tailed policy would forgive too much."""
    total = np.bincount(demonstration, weight)
    trust = total / np.bincount(demonstration)
    center = np.average(actions, axis=0, weights=weight)
    variance = np.average((actions - center) ** 2, axis=0, weights=weight)
    error = ((actions - mean) ** 2 / np.where(variance > 0, variance, 1.0)).mean(axis=1)
    loss = np.bincount(demonstration, weight * error) / total
    return _Held(choice, -float(np.average(loss, weights=trust)), -loss)


_JUDGES = {"discrete": _judge, "continuous": _judge_numbers}


def _median(values: Array, weight: Array) -> float:
    """The weighted median: the mean of the two in the middle where the weight says so."""
    order = np.argsort(values)
    below = np.cumsum(weight[order]) / weight.sum()
    low, high = np.searchsorted(below, [0.5 - 1e-9, 0.5 + 1e-9])
    return float(0.5 * (values[order[low]] + values[order[min(high, len(values) - 1)]]))


def _as_good(held: _Held, best: _Held, trust: Array) -> bool:
    """Whether `held` hits fewer actions by no more than a standard error of the difference, over demonstrations."""
    difference = held.accuracy - best.accuracy
    mean = np.average(difference, weights=trust)
    freedom = max(len(trust) - 1, 1)
    variance = (trust**2 @ (difference - mean) ** 2) / trust.sum() ** 2 * len(trust) / freedom
    return bool(mean >= -np.sqrt(variance))
