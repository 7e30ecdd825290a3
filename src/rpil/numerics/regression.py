"""Weighted ridge regression, and errors with Student's t distribution.

a_j = x w_j + sigma_j e_j,    e_j ~ t_nu independent over the parts j of an action
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve
from scipy.special import gammaln

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
    """Added to the scale of the errors, in standard deviations of the action: a policy without errors has no density.
    Chosen by hand, not tuned."""


def standardise(actions: Num[Array, "N A"]) -> Float[Array, "N A"]:
    """Actions less their mean, in standard deviations; a part that never changes is zero."""
    return np.asarray((actions - actions.mean(axis=0)) / column_scales(actions))


def column_scales(actions: Num[Array, "N A"]) -> Float[Array, " A"]:
    """Standard deviation of each part of the actions, 1 where it never changes."""
    spread = actions.std(axis=0)
    return np.where(spread > 0, spread, 1.0)


def robust_scale(values: Num[Array, "N A"], offsets: Int[Array, " M1"]) -> tuple[Float[Array, " A"], Float[Array, " A"]]:
    """Location and spread (A,) of the columns of the steps ``offsets[m]:offsets[m + 1]`` of demonstrations m: the
    median, and the standard deviation within the median demonstration.

    The spread of a column that is constant within most demonstrations is the root mean square distance from the
    location within the median one of the demonstrations where that is not zero; 1 where the column never changes.
    One demonstration has no influence on either, however far off it is.
    """
    values, starts, lengths = np.asarray(values, dtype=float), offsets[:-1], np.diff(offsets)[:, None]
    location = np.median(values, axis=0)
    distance = values - location
    mean = np.add.reduceat(distance, starts, axis=0) / lengths
    around = np.sqrt(np.add.reduceat(distance**2, starts, axis=0) / lengths)
    around[around <= ROUNDING * np.abs(location)] = 0.0
    within = np.sqrt(np.add.reduceat((distance - np.repeat(mean, lengths[:, 0], axis=0)) ** 2, starts, axis=0) / lengths)
    within[within <= ROUNDING * around] = 0.0
    spread = np.median(within, axis=0)
    for column in np.flatnonzero(spread == 0):
        distant = around[around[:, column] > 0, column]
        spread[column] = np.median(distant) if len(distant) else 1.0
    return location, spread


def normal_equations(
    features: Float[Array, "N D"], actions: Float[Array, "N A"], weight: Float[Array, " N"]
) -> tuple[Float[Array, "D D"], Float[Array, "D A"], float]:
    """X^T W X, X^T W Y and the sum of the weights: the sums from which `solve_ridge` fits."""
    weighted = features * weight[:, None]
    return weighted.T @ features, weighted.T @ actions, float(weight.sum())


def solve_ridge(
    gram: Float[Array, "D D"], product: Float[Array, "D A"], total: float, ridge: float
) -> Float[Array, "D A"]:
    """Coefficients of weighted ridge regression; the constant, the last column, has no penalty.

    `ridge` is the penalty a step, `total` the sum of the weights; see `normal_equations`.
    """
    total = max(total, MIN_WEIGHT)
    penalised = np.asarray(gram, dtype=float).copy()
    penalised[np.diag_indices_from(penalised)] += np.append(np.full(len(gram) - 1, ridge * total), 1e-9 * total)
    return np.asarray(solve(penalised, product, assume_a="pos"))


def error_scale(errors: Float[Array, "N A"], weight: Float[Array, " N"], settings: ErrorSettings) -> Float[Array, " A"]:
    """Robust scale of the errors of each part: 1.35 times their weighted median, plus `min_scale`."""
    order = np.argsort(np.abs(errors), axis=0)
    total = np.cumsum(np.maximum(weight, MIN_WEIGHT)[order], axis=0)
    middle = (total < 0.5 * total[-1]).sum(axis=0)
    parts = np.arange(errors.shape[1])
    return np.asarray(1.35 * np.abs(errors[order[middle, parts], parts]) + settings.min_scale)


def student_log_density(
    errors: Float[Array, "N A"], scale: Float[Array, " A"], settings: ErrorSettings
) -> Float[Array, " N"]:
    """Log-density of independent Student errors, summed over the parts, in nats."""
    nu = settings.degrees_of_freedom
    constant = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi)
    of_parts = constant - np.log(scale) - (nu + 1) / 2 * np.log1p((errors / scale) ** 2 / nu)
    return np.asarray(of_parts.sum(axis=1))
