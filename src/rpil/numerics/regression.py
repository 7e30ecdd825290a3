"""Weighted ridge regression, and errors with Student's t distribution.

a_j = x w_j + sigma_j e_j,    e_j ~ t_nu independent over the parts j of an action
"""

from __future__ import annotations

from dataclasses import dataclass
from math import lgamma

import numpy as np

from rpil.numerics.types import Array, Float, Int, Num

MIN_WEIGHT = 1e-6
"""Lower bound of the weight of steps, so that a fold without weight is no division by zero."""

ROUNDING = 1e-12
"""Differences relative to the values, up to which these are equal but for rounding."""


@dataclass(frozen=True)
class ErrorSettings:
    """The errors of actions that are standardised."""

    degrees_of_freedom: float = 4.0
    """nu. docs/tried.md: 2 and 1 were no better."""
    min_scale: float = 0.03
    """Added to the scale of the errors, in standard deviations of the action, so that a density exists. Not tuned."""


def column_scales(actions: Num[Array, "N A"]) -> Float[Array, " A"]:
    """Standard deviation of each part of the actions, 1 where it never changes."""
    return np.where((spread := actions.std(axis=0)) > 0, spread, 1.0)


def medians(values: Num[Array, "*batch N"]) -> Float[Array, "*batch"]:
    """The medians of finite numbers along the last axis, as of `numpy.median`, which takes four times as long."""
    half = values.shape[-1] // 2
    parted = np.partition(np.ascontiguousarray(values), half, axis=-1)
    return np.asarray((parted[..., half] + parted[..., : half + values.shape[-1] % 2].max(axis=-1)) / 2)


def robust_scale(
    values: Num[Array, "N A"], offsets: Int[Array, " M1"]
) -> tuple[Float[Array, " A"], Float[Array, " A"]]:
    """Location and spread (A,) of columns whose steps ``offsets[m]:offsets[m + 1]`` are those of demonstration m: the
    median, and the root mean square distance from it within the median demonstration.

    Where most demonstrations are at the location all the time, the spread is that of the median one of the others; 1
    where all are. One demonstration has no influence on either, however far off it is.
    """
    values = np.asarray(values, dtype=float)
    location = medians(values.T)
    distance = np.add.reduceat((values - location) ** 2, offsets[:-1], axis=0) / np.diff(offsets)[:, None]
    distance[distance <= (ROUNDING * location) ** 2] = 0.0
    median = np.median(distance, axis=0)
    for column in np.flatnonzero(median == 0):
        positive = distance[distance[:, column] > 0, column]
        median[column] = np.median(positive) if len(positive) else 1.0
    return location, np.sqrt(median)


def spread_within(values: Num[Array, "N A"], offsets: Int[Array, " M1"]) -> Float[Array, " A"]:
    """Spread (A,): the standard deviation within the median demonstration, wherever each of them is; that of
    `robust_scale` where most demonstrations do not move."""
    (location, spread), lengths = robust_scale(values, offsets), np.diff(offsets)
    distance = np.asarray(values, dtype=float) - location
    means = np.add.reduceat(distance, offsets[:-1], axis=0) / lengths[:, None]
    squares = (distance - np.repeat(means, lengths, axis=0)) ** 2
    within = np.sqrt(np.median(np.add.reduceat(squares, offsets[:-1], axis=0) / lengths[:, None], axis=0))
    return np.where(within > ROUNDING * np.maximum(spread, np.abs(location)), within, spread)


def mean_ranks(values: Num[Array, " M"]) -> Float[Array, " M"]:
    """The ranks of values from 1 on; equal values share the mean of theirs."""
    order, ranks = np.argsort(values), np.empty(len(values))
    ranked = values[order]
    bounds = np.flatnonzero(np.concatenate([[True], ranked[1:] != ranked[:-1], [True]]))
    ranks[order] = np.repeat((bounds[1:] + bounds[:-1] + 1) / 2, np.diff(bounds))
    return ranks


def normal_equations(
    features: Float[Array, "N D"], actions: Float[Array, "N A"], weight: Float[Array, " N"]
) -> tuple[Float[Array, "D D"], Float[Array, "D A"], float]:
    """X^T W X, X^T W Y and the sum of the weights: the sums from which `solve_ridge` fits."""
    used = weight > 0.0
    if not used.all():
        features, actions, weight = features[used], actions[used], weight[used]
    root = np.sqrt(weight)[:, None]
    weighted = features * root
    return weighted.T @ weighted, weighted.T @ (actions * root), float(weight.sum())  # X^T X takes half of X^T Y


def solve_ridge(
    gram: Float[Array, "D D"], product: Float[Array, "D A"], total: float, ridge: float
) -> Float[Array, "D A"]:
    """Coefficients of weighted ridge regression; the constant, the last column, has no penalty.

    `ridge` is the penalty a step, `total` the sum of the weights; see `normal_equations`.
    """
    from scipy.linalg import cho_factor, cho_solve  # which `rpil check` does without

    total = max(total, MIN_WEIGHT)
    penalised = np.array(gram, dtype=float)
    penalised[np.diag_indices_from(penalised)] += np.append(np.full(len(gram) - 1, ridge * total), 1e-9 * total)
    factor = cho_factor(penalised, overwrite_a=True, check_finite=False)
    return np.asarray(cho_solve(factor, product, check_finite=False))


def error_scale(errors: Float[Array, "N A"], weight: Float[Array, " N"], settings: ErrorSettings) -> Float[Array, " A"]:
    """Robust scale of the errors of each part: 1.35 times their median in the steps with weight, or in all without any,
    plus `min_scale`."""
    used = weight > 0.0
    return 1.35 * medians(np.abs(errors if used.all() or not used.any() else errors[used]).T) + settings.min_scale


def student_log_densities(
    errors: Float[Array, "*shape"], scale: Float[Array, "*of_each"], settings: ErrorSettings
) -> Float[Array, "*shape"]:
    """Log-densities of Student errors of any shape, each with its `scale`, in nats."""
    nu, found = settings.degrees_of_freedom, np.asarray(errors / scale)  # in whose place all is computed: it is large
    constant = lgamma((nu + 1) / 2) - lgamma(nu / 2) - 0.5 * np.log(nu * np.pi)
    np.log1p(np.divide(np.square(found, out=found), nu, out=found), out=found)
    found *= (nu + 1) / 2
    return np.asarray(np.subtract(constant - np.log(scale), found, out=found))
