"""Weighted ridge regression, and errors with Student's t distribution."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve
from scipy.special import gammaln

from rpil.numerics.types import Array

FREEDOM = 4.0
"""Degrees of freedom of the errors of continuous actions."""

LEAST_SCALE = 0.03
"""Standard deviations of an action that its error's scale is enlarged by: a policy that is exact has no density."""

MIN_WEIGHT = 1e-6
"""Of a step that teaches nothing, so that a fold without teachers is no division by zero."""


def standardise(actions: Array) -> Array:
    """Actions (N, A) less their mean, in standard deviations; an action that never changes stays zero."""
    result: Array = (actions - actions.mean(axis=0)) / column_scales(actions)
    return result


def column_scales(actions: Array) -> Array:
    """Standard deviation of each part of actions (N, A), 1 where it never changes, (A,)."""
    spread = actions.std(axis=0)
    return np.where(spread > 0, spread, 1.0)


def normal_equations(features: Array, actions: Array, weight: Array) -> tuple[Array, Array, float]:
    """X^T W X (D, D), X^T W Y (D, A) and the sum of the weights."""
    weighted = features * weight[:, None]
    return weighted.T @ features, weighted.T @ actions, float(weight.sum())


def solve_ridge(gram: Array, product: Array, total: float, ridge: float) -> Array:
    """Coefficients (D, A) of weighted ridge regression, the constant (last column) without a penalty."""
    total = max(total, MIN_WEIGHT)
    penalised = np.asarray(gram, dtype=float).copy()
    penalised[np.diag_indices_from(penalised)] += np.append(np.full(len(gram) - 1, ridge * total), 1e-9 * total)
    found: Array = solve(penalised, product, assume_a="pos")
    return found


def error_scale(errors: Array, weight: Array) -> Array:
    """Robust scale of each part's errors (N, A), by weighted median, (A,)."""
    order = np.argsort(np.abs(errors), axis=0)
    total = np.cumsum(np.maximum(weight, MIN_WEIGHT)[order], axis=0)
    middle = (total < 0.5 * total[-1]).sum(axis=0)
    parts = np.arange(errors.shape[1])
    return 1.35 * np.abs(errors[order[middle, parts], parts]) + LEAST_SCALE


def student_log_density(errors: Array, scale: Array) -> Array:
    """Log-density of independent Student errors (N, A), summed over the parts, (N,), nats."""
    constant = gammaln((FREEDOM + 1) / 2) - gammaln(FREEDOM / 2) - 0.5 * np.log(FREEDOM * np.pi)
    each = constant - np.log(scale) - (FREEDOM + 1) / 2 * np.log1p((errors / scale) ** 2 / FREEDOM)
    total: Array = each.sum(axis=1)
    return total
