"""Choosing what a policy sees, and how smooth it is, by demonstrations that were held out.

Every kind of features is cross-fitted over demonstrations, each with as much say as it is trusted: bad demonstrations
do not choose. The kind is chosen by likelihood: the median's over demonstrations, because a single one that went
where no other did decides every mean; and at the best temperature, because a policy acts by its most likely action,
which being too sure does not change. The ridge is chosen by that action: the weakest one that hits as many held-out
actions as the best, up to a standard error. A strong ridge makes likelihoods safe and decisions flat.

Continuous actions are predicted by robust ridge regression, and its squared error chooses both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve
from scipy.optimize import minimize_scalar

from rpil.data.spaces import Discrete, Space
from rpil.numerics.blocks import linear, log_softmax
from rpil.numerics.newton import NewtonSettings, fit_softmax
from rpil.numerics.regression import MIN_WEIGHT, ErrorSettings, column_scales, normal_equations
from rpil.numerics.types import Array
from rpil.policies.features import KINDS, RIDGE_PER_STEP, FeatureMap, ridge_of
from rpil.policies.softmax import one_hot

RIDGES = (1e-2, 1e-3, 1e-4, 1e-5)
"""Penalties a step, from strong to weak: each fit starts from the one before."""

_ROUNDS = 4
"""Least squares after which steps that are far off count for less: one that was wrongly kept must not choose."""

_N_FOLDS = 5
_MOST_STEPS = 6_000
_MOST_COLUMNS = 450
_TEMPERATURES = (np.log(0.03), np.log(5.0))


@dataclass(frozen=True)
class Choice:
    """A kind of features, the penalty a step, and what logits are multiplied by to be as sure as demonstrations allow
    that were held out."""

    kind: str
    ridge: float = RIDGE_PER_STEP
    temperature: float = 1.0


Average = Callable[[Array], Array]
"""Of the steps (N,) of each demonstration, (M,)."""


class _Held(NamedTuple):
    """What held-out demonstrations say of a choice: its `value` as a kind of features, and how accurate it is on each
    of them, (M,)."""

    choice: Choice
    value: float
    accuracy: Array


def choose_features(
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
    steps, demonstration = _sample(offsets, weight)
    observations, codes, weight = observations[steps], codes[steps], weight[steps]
    targets = one_hot(codes, np.ones(len(codes)), space.n) if isinstance(space, Discrete) else codes
    learn, judge = _METHODS[space.kind]
    total = np.bincount(demonstration, weight)
    trust = total / np.bincount(demonstration)

    def average(values: Array) -> Array:
        averages: Array = np.bincount(demonstration, weight * values) / total
        return averages

    fold = demonstration % _N_FOLDS
    found: list[_Held] = []
    for kind in KINDS:
        if kind != "raw" and _n_columns(kind, observations.shape[1]) > _MOST_COLUMNS:
            continue
        features = FeatureMap.fit(kind, observations, weight)
        maps = [replace(features, ridge_per_step=ridge) for ridge in (RIDGES if C is None else (RIDGE_PER_STEP,))]
        design = features.design(observations, single=space.kind == "discrete")
        outputs = np.empty((len(maps), *targets.shape))
        for test in (fold == k for k in np.unique(fold)):
            train = ~test
            penalties = [ridge_of(of, C, weight[train].sum(), space) for of in maps]
            for r, coefficients in enumerate(learn(design[train], targets[train], weight[train], penalties)):
                outputs[r, test] = space.bounded(linear(design[test], coefficients))
        choices = [Choice(kind, of.ridge_per_step) for of in maps]
        found += [judge(of, said, targets, average, trust) for of, said in zip(choices, outputs, strict=True)]
    kind = max(found, key=lambda held: held.value).choice.kind
    alike = [held for held in found if held.choice.kind == kind]
    best = max(alike, key=lambda held: float(np.average(held.accuracy, weights=trust)))
    return min((held.choice for held in alike if _as_good(held, best, trust)), key=lambda choice: choice.ridge)


def _sample(offsets: Array, weight: Array) -> tuple[Array, Array]:
    """Steps to choose by, and the demonstration of each, 0, 1 ..: whole demonstrations of some weight."""
    rng = np.random.default_rng(0)
    lengths = np.diff(offsets)
    trust = np.add.reduceat(weight, offsets[:-1]) / lengths
    order = rng.permutation(np.flatnonzero(trust > 0.1 * trust.max()))
    enough = int(np.searchsorted(np.cumsum(lengths[order]), _MOST_STEPS)) + 1
    kept = order[: max(enough, 2)]
    steps = np.concatenate([np.arange(offsets[m], offsets[m + 1]) for m in kept])
    if len(kept) > 1:
        return steps, np.repeat(np.arange(len(kept)), lengths[kept])
    steps = steps[weight[steps] > 0.0]  # parts of the only demonstration stand for demonstrations
    return steps, np.arange(len(steps)) * min(_N_FOLDS, len(steps)) // len(steps)


def _n_columns(kind: str, n_observations: int) -> int:
    """About how many columns a kind has."""
    n = n_observations
    return {"raw": n, "folded": 2 * n, "spline": 10 * n, "poly": n * (n + 3) // 2, "nystroem": 2 * n + 200}[kind]


def _softmax(design: Array, targets: Array, weight: Array, penalties: list[Array]) -> Iterator[Array]:
    """Coefficients (D, K) for each penalty."""
    start: Array | None = None
    for penalty in penalties:
        fit = fit_softmax(design, targets * weight[:, None], penalty, NewtonSettings(1e-3, 20, 30), start=start)
        start = fit.weights
        yield start


def _least_squares(design: Array, actions: Array, weight: Array, penalties: list[Array]) -> Iterator[Array]:
    """Coefficients (D, A) for each penalty; steps that are far off count for less, as under Student's errors."""
    weight, errors = np.maximum(weight, MIN_WEIGHT), ErrorSettings()  # a fold may have no step of any weight
    trust, least = weight, (errors.min_scale * column_scales(actions)) ** 2
    nu = errors.degrees_of_freedom
    for _ in range(_ROUNDS):
        gram, product, _ = normal_equations(design, actions, trust)
        squares = (actions - design @ solve(gram + np.diag(penalties[-1]), product, assume_a="pos")) ** 2
        distance = squares / ((trust @ squares) / weight.sum() + least)
        trust = weight * (nu + actions.shape[1]) / (nu + distance.sum(axis=1))
    gram, product, _ = normal_equations(design, actions, trust)
    for penalty in penalties:
        yield solve(gram + np.diag(penalty), product, assume_a="pos")


def _judge_logits(choice: Choice, logits: Array, targets: Array, average: Average, trust: Array) -> _Held:
    def loss(log_temperature: float) -> float:
        return -_median(average((targets * log_softmax(np.exp(log_temperature) * logits)).sum(axis=1)), trust)

    found = minimize_scalar(loss, bounds=_TEMPERATURES, method="bounded", options={"xatol": 0.02})
    hit = average(logits.argmax(axis=1) == targets.argmax(axis=1))
    return _Held(replace(choice, temperature=float(np.exp(found.x))), -float(found.fun), hit)


def _judge_numbers(choice: Choice, mean: Array, actions: Array, average: Average, trust: Array) -> _Held:
    """Within the box no single demonstration can make squared errors infinite, so that their mean decides."""
    loss = average((((actions - mean) / column_scales(actions)) ** 2).mean(axis=1))
    return _Held(choice, -float(np.average(loss, weights=trust)), -loss)


_METHODS = {"discrete": (_softmax, _judge_logits), "continuous": (_least_squares, _judge_numbers)}


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
