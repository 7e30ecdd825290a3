"""Weighted, soft-target, ridge-penalised softmax regression by truncated Newton.

One solver serves behavioural cloning (hard targets), every M-step of EM (soft targets, warm start, few steps) and the
final refit (weights). Newton directions come from preconditioned conjugate gradients on Hessian products, the
preconditioner from the exact class blocks of the Hessian on a subsample of steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpil.numerics.blocks import gradient, hessian_product, linear, log_softmax
from rpil.numerics.types import Array

_PRECONDITIONER_ROWS = 8192
"""At least so many steps, and four a feature, give the preconditioner."""

_PRECONDITIONER_STEPS = 4
"""Newton steps that one preconditioner serves."""

HISTORY_LENGTH = 30
"""Steps of a path that a Newton step takes into account."""

_LARGEST = 1_500
"""Coefficients up to which the whole Hessian is inverted where it serves many passes over much data."""


@dataclass(frozen=True)
class NewtonSettings:
    """When `fit_softmax` stops.

    Attributes
    ----------
    tol : float
        Largest entry of the gradient, divided by the total weight of the steps, at which the fit has converged.
    max_iter : int
        Newton steps at most; 1 is one improving step.
    max_cg : int
        Hessian products in each Newton step at most.
    """

    tol: float = 1e-6
    max_iter: int = 100
    max_cg: int = 200


class SoftmaxFit(NamedTuple):
    """Where the solver stopped.

    Attributes
    ----------
    weights : (D, K) array
    log_proba : (N, K) array
        Log-probabilities of all actions at `weights`.
    objective : float
        Penalised negative log-likelihood at `weights`.
    converged : bool
    preconditioner : Preconditioner or None
        The last one made: good enough for a problem nearby.
    """

    weights: Array
    log_proba: Array
    objective: float
    converged: bool
    preconditioner: Preconditioner | None


def fit_softmax(
    features: Array,
    targets: Array,
    penalty: Array,
    settings: NewtonSettings = NewtonSettings(),
    *,
    start: Array | None = None,
    preconditioner: Preconditioner | None = None,
) -> SoftmaxFit:
    """Minimise -sum_nk T_nk log softmax(x_n W)_k + 1/2 sum_dk penalty_d W_dk^2.

    Parameters
    ----------
    features : (N, D) array
        Design matrix, with a constant column where an intercept is wanted.
    targets : (N, K) array
        Non-negative soft targets; a row's sum is the weight of the step.
    penalty : (D,) array
        Ridge penalty of each feature (0 for the constant).
    settings : NewtonSettings
    start : (D, K) array, optional
        Where to start; zero by default.
    preconditioner : Preconditioner, optional
        Of a problem nearby, for the first Newton steps.

    Returns
    -------
    SoftmaxFit
        Its objective is never above the one at `start`.
    """
    ridge = penalty[:, None]
    weight = targets.sum(axis=1)
    scale = max(float(weight.sum()), np.finfo(float).tiny)
    weights = np.zeros((features.shape[1], targets.shape[1])) if start is None else np.array(start, dtype=float)
    logits = linear(features, weights)
    log_proba = log_softmax(logits)
    objective = _objective(log_proba, targets, weights, ridge)

    for n_iter in range(settings.max_iter + 1):
        proba = np.exp(log_proba)
        slope = gradient(features, weight[:, None] * proba - targets) + ridge * weights
        norm = float(np.abs(slope).max()) / scale
        if norm <= settings.tol or n_iter == settings.max_iter:
            return SoftmaxFit(weights, log_proba, objective, norm <= settings.tol, preconditioner)
        if preconditioner is None or (n_iter and n_iter % _PRECONDITIONER_STEPS == 0):
            preconditioner = Preconditioner(features, proba, weight, penalty)
        step = _newton_direction(features, proba, weight, ridge, slope, preconditioner, settings.max_cg)

        # Logits move on a line, so that a trial length costs no pass over the features.
        step_logits = linear(features, step)
        descent = float((slope * step).sum())
        length = 1.0
        while True:
            trial = weights + length * step
            trial_log_proba = log_softmax(logits + length * step_logits)
            trial_objective = _objective(trial_log_proba, targets, trial, ridge)
            if trial_objective <= objective + 1e-4 * length * descent:
                break
            length *= 0.5
            if length < 1e-10:  # rounding is all that is left to gain
                return SoftmaxFit(weights, log_proba, objective, norm <= 100 * settings.tol, preconditioner)
        weights, log_proba, objective = trial, trial_log_proba, trial_objective
        logits = logits + length * step_logits
    raise AssertionError("unreachable")


def _objective(log_proba: Array, targets: Array, weights: Array, ridge: Array) -> float:
    return float(0.5 * (ridge * weights**2).sum() - np.einsum("nk,nk->", targets, log_proba, dtype=float))


def _newton_direction(
    features: Array, proba: Array, weight: Array, ridge: Array, slope: Array, precondition: Preconditioner, max_cg: int
) -> Array:
    """Approximately solve H step = -slope; the relative residual shrinks with the gradient (Eisenstat-Walker)."""
    proba, weight = (a.astype(features.dtype, copy=False) for a in (proba, weight))
    step = np.zeros_like(slope)
    residual = -slope
    preconditioned = precondition(residual)
    direction = preconditioned
    energy = first = float((residual * preconditioned).sum())
    scale = max(float(weight.sum(dtype=float)), np.finfo(float).tiny)
    forcing = min(0.25, np.sqrt(np.sqrt(first / scale)))
    for _ in range(max_cg):
        product = hessian_product(features, proba, weight, direction) + ridge * direction
        curvature = float((direction * product).sum())
        if curvature <= 1e-14 * float((direction * direction).sum()):
            break
        length = energy / curvature
        step += length * direction
        residual = residual - length * product
        preconditioned = precondition(residual)
        previous, energy = energy, float((residual * preconditioned).sum())
        if energy <= forcing**2 * first:
            break
        direction = preconditioned + (energy / previous) * direction
    return step if step.any() else -slope


def lbfgs_step(path: Array, precondition: Callable[[Array], Array]) -> Array:
    """Uphill from the end of a path, (D, K): gradients along the way tell of the Hessian, beside a preconditioner
    (L-BFGS, Nocedal 1980). `path` (T, 2, D, K) holds places, and the gradient of the objective at each."""
    moves = np.diff(path, axis=0)
    pairs = [(step, -change, -float((step * change).sum())) for step, change in moves]
    pairs = [pair for pair in pairs if pair[2] > 0.0]
    rest, shares = path[-1, 1], []
    for step, fall, curvature in reversed(pairs):
        shares.append(float((step * rest).sum()) / curvature)
        rest = rest - shares[-1] * fall
    found = precondition(rest)
    for (step, fall, curvature), share in zip(pairs, reversed(shares), strict=True):
        found = found + (share - float((fall * found).sum()) / curvature) * step
    return found


class Preconditioner:
    """Inverse of the Hessian's class blocks X^T diag(s p_k (1 - p_k)) X + penalty, from an even subsample of the steps.

    Parameters
    ----------
    features : (N, D) array
    proba : (N, K) array
        The policy's.
    weight : (N,) array
    penalty : (D,) array
    doubt : float, optional
        Curvature that may be anywhere without these steps knowing. Where it is given the steps are few
        and the matrix serves many passes: all are read, and the whole Hessian is inverted where it has no more than
        `_LARGEST` rows.
    """

    def __init__(
        self, features: Array, proba: Array, weight: Array, penalty: Array, doubt: float | None = None
    ) -> None:
        self.doubt = doubt
        n_steps, n_features = features.shape
        stride = 1 if doubt else max(1, n_steps // max(_PRECONDITIONER_ROWS, 4 * n_features))
        x, p, s = features[::stride], proba[::stride], stride * weight[::stride]
        if doubt and n_features * p.shape[1] <= _LARGEST:
            hessian = _coupled(x.astype(float, copy=False), p, s)[None]
            penalty = np.tile(penalty, p.shape[1])
        else:
            curvature = (s[:, None] * p * (1 - p)).astype(x.dtype, copy=False)
            hessian = np.stack([(x.T * curvature[:, k]) @ x for k in range(p.shape[1])]).astype(float)
        floor = max(1e-8, 100 * np.finfo(x.dtype).eps) if len(hessian) > 1 else 1e-9
        diagonal = np.einsum("kdd->kd", hessian)
        # The floor keeps a class that the subsample hardly sees invertible, and is above the product's rounding.
        diagonal += penalty + floor * (1e-8 + diagonal.max(axis=1, keepdims=True))
        if doubt and len(hessian) > 1:
            # Class blocks underestimate the curvature between two actions by up to a half: steps of 2/3 of their length
            # are never far too long nor far too short.
            hessian *= 1.5
        self.inverse = np.linalg.inv(hessian)
        self.hessian = hessian if doubt else None

    def __call__(self, residual: Array, radius: float = np.inf) -> Array:
        """The step H^-1 residual; with a finite radius (H + c I)^-1 residual, where c is `doubt` / `radius` at least
        and makes no entry larger than `radius`."""
        n_features, n_actions = residual.shape
        parts = residual.T.reshape(len(self.inverse), -1, 1)

        def step(inverse: Array) -> Array:
            return (inverse @ parts).reshape(n_actions, n_features).T

        if radius == np.inf:
            return step(self.inverse)
        assert self.hessian is not None
        assert self.doubt is not None
        axes, c = np.eye(parts.shape[1]), self.doubt / radius
        while np.abs(found := step(np.linalg.inv(self.hessian + c * axes))).max() > radius:
            c *= 4.0
        return found


def _coupled(features: Array, proba: Array, weight: Array) -> Array:
    """The Hessian, (K D, K D), whose blocks are X^T diag(s p_k (1[k = l] - p_l)) X."""
    n_features, n_actions = features.shape[1], proba.shape[1]
    hessian = np.empty((n_actions, n_features, n_actions, n_features))
    for k in range(n_actions):
        for j in range(k + 1):
            curvature = weight * proba[:, k] * (float(j == k) - proba[:, j])
            hessian[k, :, j] = (features.T * curvature) @ features
            hessian[j, :, k] = hessian[k, :, j].T
    return hessian.reshape(n_actions * n_features, -1)
