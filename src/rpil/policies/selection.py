"""The choice of the feature map and its ridge, by held-out demonstrations (``features="auto"``).

Every kind of feature map is cross-fitted over demonstrations, each weighted by the trust in it, so that bad
demonstrations have little influence. The kind is chosen by the median log-likelihood over demonstrations, because one
demonstration in states of its own would decide every mean; and at the best temperature, because the most likely
action does not depend on it. The ridge is the weakest one that predicts as many held-out actions as the best one, up to
a standard error: strong ridges have safe likelihoods and flat decisions.

Continuous actions are predicted by robust ridge regression, whose squared error chooses both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve
from scipy.optimize import minimize_scalar

from rpil.data.archive import stored
from rpil.data.spaces import Discrete, Space
from rpil.numerics.blocks import linear, log_softmax
from rpil.numerics.newton import NewtonSettings, fit_softmax
from rpil.numerics.regression import MIN_WEIGHT, ErrorSettings, column_scales, normal_equations
from rpil.numerics.types import Array, Float, Int, Num
from rpil.policies.features import FEATURE_KINDS, FeatureMap, FeatureSettings, ridge_of
from rpil.policies.softmax import one_hot

for settings_class in (NewtonSettings, ErrorSettings):
    stored()(settings_class)  # here, because numerics knows nothing of archives


@stored()
@dataclass(frozen=True)
class SelectionSettings:
    """How features are chosen. benchmarks/features.py compares the choice with every single kind; unless stated
    otherwise, values were chosen by hand, not tuned.

    Attributes
    ----------
    ridges : tuple of float
        Ridges a step to choose from, the strongest first: each fit starts from the one before.
    n_folds : int
        Folds of demonstrations; one demonstration alone is cut into as many parts.
    max_steps : int
        Steps of the demonstrations by which features are chosen, about, at most.
    max_columns : int
        Columns of a feature map, at most; kinds with more are no candidates.
    min_trust : float
        Mean weight of a demonstration's steps, relative to the largest one, from which it is used.
    temperatures : (float, float)
        Bounds of the temperature.
    newton : NewtonSettings
        When a softmax fit stops.
    n_reweightings : int
        Least-squares fits after each of which steps with large errors get less weight: a bad step that is trusted by
        mistake must not choose.
    errors : ErrorSettings
        Distribution of the errors by which they do.
    """

    ridges: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-5)
    n_folds: int = 5
    max_steps: int = 6_000
    max_columns: int = 450
    min_trust: float = 0.1
    temperatures: tuple[float, float] = (0.03, 5.0)
    newton: NewtonSettings = NewtonSettings(tol=1e-3, max_iter=20, max_cg=30)
    n_reweightings: int = 4
    errors: ErrorSettings = ErrorSettings()


@dataclass(frozen=True)
class Choice:
    """A kind of feature map, its ridge a step, and the temperature, by which logits are multiplied, of the best
    held-out likelihood."""

    kind: str
    ridge: float = FeatureSettings.ridge_per_step
    temperature: float = 1.0


class _Demonstrations(NamedTuple):
    """The number (N,) of the demonstration of each step, the weights (N,), their sums (M,), and their means (M,)."""

    number: Array
    weight: Array
    total: Array
    trust: Array

    def average(self, values: Array) -> Array:
        """Weighted means (M,) of values of steps (N,)."""
        return np.asarray(np.bincount(self.number, self.weight * values) / self.total)


class _Candidate(NamedTuple):
    """A choice, its `value` as a kind of features, and its `accuracy` (M,) on each held-out demonstration."""

    choice: Choice
    value: float
    accuracy: Array


def choose_features(
    observations: Num[Array, "N D"],
    codes: Num[Array, "N ..."],
    offsets: Int[Array, " M_plus_1"],
    weight: Float[Array, " N"],
    space: Space,
    C: float | None = None,
    settings: SelectionSettings = SelectionSettings(),
) -> Choice:
    """The feature map, ridge and temperature under which held-out demonstrations are predicted best.

    Parameters
    ----------
    codes : (N,) int array, or (N, A) array
        Actions, 0 .. K-1, or numbers.
    offsets : (M + 1,) int array
        Demonstration m owns the steps ``offsets[m]:offsets[m + 1]``.
    weight : (N,) array
        Trust in each step.
    space : Space
        Space of the actions.
    C : float, optional
        Inverse ridge strength of scikit-learn; if given, it is not chosen.
    """
    steps, number = _sample(offsets, weight, settings)
    observations, codes, weight = observations[steps], codes[steps], weight[steps]
    discrete = isinstance(space, Discrete)
    targets = one_hot(codes, np.ones(len(codes)), space.n) if isinstance(space, Discrete) else codes
    fit, assess = (_fit_softmax, _assess_logits) if discrete else (_fit_least_squares, _assess_means)
    total = np.bincount(number, weight)
    demonstrations = _Demonstrations(number, weight, total, total / np.bincount(number))
    fold, ridges = number % settings.n_folds, settings.ridges if C is None else (FeatureSettings.ridge_per_step,)
    candidates: list[_Candidate] = []
    for kind in FEATURE_KINDS:
        if kind != "raw" and _n_columns(kind, observations.shape[1]) > settings.max_columns:
            continue
        features = FeatureMap.fit(kind, observations, weight)
        maps = [replace(features, ridge_per_step=ridge) for ridge in ridges]
        design = features.design(observations, single=discrete)
        outputs = np.empty((len(maps), *targets.shape))
        for test in (fold == k for k in np.unique(fold)):
            train = ~test
            penalties = [ridge_of(of, C, weight[train].sum(), space) for of in maps]
            for r, coefficients in enumerate(fit(design[train], targets[train], weight[train], penalties, settings)):
                outputs[r, test] = space.bounded(linear(design[test], coefficients))
        for ridge, of_ridge in zip(ridges, outputs, strict=True):
            candidates.append(assess(Choice(kind, ridge), of_ridge, targets, demonstrations, settings))
    return _weakest_ridge(candidates, demonstrations.trust)


def _weakest_ridge(candidates: list[_Candidate], trust: Array) -> Choice:
    """The choice of the best kind with the weakest ridge that is as accurate as the best one."""
    kind = max(candidates, key=lambda candidate: candidate.value).choice.kind
    of_kind = [candidate for candidate in candidates if candidate.choice.kind == kind]
    best = max(of_kind, key=lambda candidate: float(np.average(candidate.accuracy, weights=trust)))
    as_good = (candidate.choice for candidate in of_kind if _is_as_good(candidate, best, trust))
    return min(as_good, key=lambda choice: choice.ridge)


def _sample(offsets: Array, weight: Array, settings: SelectionSettings) -> tuple[Array, Array]:
    """Steps by which to choose, and the number 0, 1 .. of each one's demonstration: whole trusted demonstrations."""
    rng = np.random.default_rng(0)
    lengths = np.diff(offsets)
    trust = np.add.reduceat(weight, offsets[:-1]) / lengths
    order = rng.permutation(np.flatnonzero(trust > settings.min_trust * trust.max()))
    enough = int(np.searchsorted(np.cumsum(lengths[order]), settings.max_steps)) + 1
    kept = order[: max(enough, 2)]
    steps = np.concatenate([np.arange(offsets[m], offsets[m + 1]) for m in kept])
    if len(kept) > 1:
        return steps, np.repeat(np.arange(len(kept)), lengths[kept])
    steps = steps[weight[steps] > 0.0]  # parts of the only demonstration stand for demonstrations
    return steps, np.arange(len(steps)) * min(settings.n_folds, len(steps)) // len(steps)


def _n_columns(kind: str, n_observations: int) -> int:
    """Columns of the feature map, about."""
    n, of = n_observations, FeatureSettings
    counts = {"raw": n, "folded": 2 * n, "spline": (of.n_knots + 2) * n, "poly": n * (n + 3) // 2}
    return counts[kind] if kind in counts else 2 * n + of.n_landmarks


def _fit_softmax(
    design: Array, targets: Array, weight: Array, penalties: list[Array], settings: SelectionSettings
) -> Iterator[Array]:
    """Coefficients (D, K) for each penalty."""
    start: Array | None = None
    for penalty in penalties:
        start = fit_softmax(design, targets * weight[:, None], penalty, settings.newton, start=start).weights
        yield start


def _fit_least_squares(
    design: Array, actions: Array, weight: Array, penalties: list[Array], settings: SelectionSettings
) -> Iterator[Array]:
    """Coefficients (D, A) for each penalty; steps with large errors get less weight, as under Student's errors."""
    weight, nu = np.maximum(weight, MIN_WEIGHT), settings.errors.degrees_of_freedom  # a fold may have no weight
    robust, least = weight, (settings.errors.min_scale * column_scales(actions)) ** 2
    for _ in range(settings.n_reweightings):
        gram, product, _ = normal_equations(design, actions, robust)
        squares = (actions - design @ solve(gram + np.diag(penalties[-1]), product, assume_a="pos")) ** 2
        distance = squares / ((robust @ squares) / weight.sum() + least)
        robust = weight * (nu + actions.shape[1]) / (nu + distance.sum(axis=1))
    gram, product, _ = normal_equations(design, actions, robust)
    for penalty in penalties:
        yield solve(gram + np.diag(penalty), product, assume_a="pos")


def _assess_logits(
    choice: Choice, logits: Array, targets: Array, demonstrations: _Demonstrations, settings: SelectionSettings
) -> _Candidate:
    """Median log-likelihood at the best temperature, and share of actions that are the most likely one."""

    def loss(log_temperature: float) -> float:
        log_likelihood = (targets * log_softmax(np.exp(log_temperature) * logits)).sum(axis=1)
        return -_median(demonstrations.average(log_likelihood), demonstrations.trust)

    bounds = np.log(settings.temperatures)
    found = minimize_scalar(loss, bounds=bounds, method="bounded", options={"xatol": 0.02})
    hit = demonstrations.average(logits.argmax(axis=1) == targets.argmax(axis=1))
    return _Candidate(replace(choice, temperature=float(np.exp(found.x))), -float(found.fun), hit)


def _assess_means(
    choice: Choice, mean: Array, actions: Array, demonstrations: _Demonstrations, settings: SelectionSettings
) -> _Candidate:
    """Minus the mean squared error: within the box no demonstration has an infinite one, so that the mean decides."""
    loss = demonstrations.average((((actions - mean) / column_scales(actions)) ** 2).mean(axis=1))
    return _Candidate(choice, -float(np.average(loss, weights=demonstrations.trust)), -loss)


def _median(values: Array, weight: Array) -> float:
    """The weighted median: the mean of the two middle values where both are medians."""
    order = np.argsort(values)
    below = np.cumsum(weight[order]) / weight.sum()
    low, high = np.searchsorted(below, [0.5 - 1e-9, 0.5 + 1e-9])
    return float(0.5 * (values[order[low]] + values[order[min(high, len(values) - 1)]]))


def _is_as_good(candidate: _Candidate, best: _Candidate, trust: Array) -> bool:
    """Whether a candidate is less accurate by no more than a standard error of the difference over demonstrations."""
    difference = candidate.accuracy - best.accuracy
    mean = np.average(difference, weights=trust)
    freedom = max(len(trust) - 1, 1)
    variance = (trust**2 @ (difference - mean) ** 2) / trust.sum() ** 2 * len(trust) / freedom
    return bool(mean >= -np.sqrt(variance))
