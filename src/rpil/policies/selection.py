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

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.numerics.blocks import linear, log_softmax, one_hot
from rpil.numerics.newton import NewtonSettings, fit_softmax
from rpil.numerics.regression import MIN_WEIGHT, column_scales, normal_equations
from rpil.numerics.types import Array, Float
from rpil.policies.features import FeatureMap, ridge_of
from rpil.policies.folds import deal, out_of_fold, pieces
from rpil.policies.settings import SelectionSettings


@dataclass(frozen=True)
class FeatureChoice:
    """A kind of feature map, its ridge a step, and the temperature, by which logits are multiplied, of the best
    held-out likelihood."""

    kind: str
    ridge: float
    temperature: float = 1.0


class _Sample(NamedTuple):
    """The demonstrations by which features are chosen, and the weights (N,) of their steps."""

    data: FitData
    weight: Array

    @property
    def trust(self) -> Array:
        """Mean weight (M,) of the steps of a demonstration."""
        return self.data.mean_steps(self.weight)

    def average(self, values: Array) -> Array:
        """Weighted means (M,) of values of steps (N,)."""
        return np.asarray(self.data.sum_steps(self.weight * values) / self.data.sum_steps(self.weight))


class _Candidate(NamedTuple):
    """A choice, its `value` as a kind of features, and its `accuracy` (M,) on each held-out demonstration."""

    choice: FeatureChoice
    value: float
    accuracy: Array


def choose_features(
    seen: FitData, weight: Float[Array, " N"], C: float | None, settings: SelectionSettings
) -> FeatureChoice:
    """The feature map, ridge and temperature under which held-out demonstrations are predicted best.

    `seen` are their observations, in the place of features, and `weight` is the trust in each step. Where `C`,
    scikit-learn's inverse ridge strength, is given, no ridge is chosen.
    """
    sample, space = _sample(seen, weight, settings), seen.space
    data, weight, discrete = sample.data, sample.weight, isinstance(space, Discrete)
    observations, ones = data.features, np.ones(len(weight))
    targets = one_hot(data.actions, ones, space.n) if isinstance(space, Discrete) else data.actions
    fit, assess = (_fit_softmax, _assess_logits) if discrete else (_fit_least_squares, _assess_means)
    fold = data.per_step(deal(data, min(settings.n_folds, data.n_demonstrations), seed=0))
    ridges = settings.ridges if C is None else (settings.maps.ridge_per_step,)

    def candidates(kind: str) -> list[_Candidate]:
        features = FeatureMap.fit(kind, observations, weight, settings=settings.maps)
        maps = [replace(features, ridge_per_step=ridge) for ridge in ridges]
        design = features.design(observations, single=discrete)

        def predict(_: int, test: Array) -> Array:
            train = ~test
            penalties = [ridge_of(of, C, weight[train].sum(), space) for of in maps]
            fits = fit(design[train], targets[train], weight[train], penalties, settings)
            return np.stack([space.bounded(linear(design[test], coefficients)) for coefficients in fits], axis=1)

        outputs = out_of_fold(fold, predict)
        return [
            assess(FeatureChoice(kind, ridge), outputs[:, r], targets, sample, settings)
            for r, ridge in enumerate(ridges)
        ]

    n = observations.shape[1]
    sizes = {"raw": n, "folded": 2 * n, "nystroem": 2 * n + settings.maps.n_landmarks}
    kinds = [kind for kind, size in sizes.items() if kind == "raw" or size <= settings.max_columns]
    of_kind = max(map(candidates, kinds), key=lambda own: max(candidate.value for candidate in own))
    best = max(of_kind, key=lambda candidate: float(np.average(candidate.accuracy, weights=sample.trust)))
    as_good = (candidate.choice for candidate in of_kind if _is_as_good(candidate, best, sample.trust))
    return min(as_good, key=lambda choice: choice.ridge)  # the weakest one that is as accurate as the best one


def _sample(data: FitData, weight: Array, settings: SelectionSettings) -> _Sample:
    """Whole trusted demonstrations, drawn at random; or parts of the only one, which stand for demonstrations."""
    trust = data.mean_steps(weight)
    order = np.argsort(deal(data, data.n_demonstrations, seed=0))
    order = order[trust[order] > settings.min_trust * trust.max()]
    enough = int(np.searchsorted(np.cumsum(data.lengths[order]), settings.max_steps)) + 1
    kept = order[: max(enough, 2)]
    if len(kept) > 1:
        steps = np.concatenate([np.arange(data.offsets[m], data.offsets[m + 1]) for m in kept])
        return _Sample(data.select(kept), weight[steps])
    steps = np.flatnonzero(data.per_step(np.arange(len(trust)) == kept[0]) & (weight > 0.0))
    only = FitData.from_steps(data.features[steps], data.actions[steps], data.space)
    return _Sample(pieces(only, settings.n_folds), weight[steps])


def _fit_softmax(
    design: Array, targets: Array, weight: Array, penalties: list[Array], settings: SelectionSettings
) -> Iterator[Array]:
    """Coefficients (D, K) for each penalty."""
    start: Array | None = None
    for penalty in penalties:
        start = fit_softmax(design, targets * weight[:, None], penalty, NewtonSettings(), start=start).weights
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
    choice: FeatureChoice, logits: Array, targets: Array, sample: _Sample, settings: SelectionSettings
) -> _Candidate:
    """Median log-likelihood at the best temperature, and share of actions that are the most likely one."""

    def loss(log_temperature: float) -> float:
        log_likelihood = (targets * log_softmax(np.exp(log_temperature) * logits)).sum(axis=1)
        return -_median(sample.average(log_likelihood), sample.trust)

    bounds = np.log(settings.temperatures)
    optimum = minimize_scalar(loss, bounds=bounds, method="bounded", options={"xatol": 0.02})
    hit = sample.average(logits.argmax(axis=1) == targets.argmax(axis=1))
    return _Candidate(replace(choice, temperature=float(np.exp(optimum.x))), -float(optimum.fun), hit)


def _assess_means(
    choice: FeatureChoice, mean: Array, actions: Array, sample: _Sample, settings: SelectionSettings
) -> _Candidate:
    """Minus the mean squared error: within the box no demonstration has an infinite one, so that the mean decides."""
    loss = sample.average((((actions - mean) / column_scales(actions)) ** 2).mean(axis=1))
    return _Candidate(choice, -float(np.average(loss, weights=sample.trust)), -loss)


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
