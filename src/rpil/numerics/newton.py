"""Weighted, soft-target, ridge-penalised softmax regression by truncated Newton.

One solver serves behavioural cloning (hard targets), every M-step of EM (soft targets, warm start, one step) and the
final policy (weights). Newton directions come from preconditioned conjugate gradients on Hessian products; the
preconditioner is the Hessian of a subsample of the steps, or its class blocks where there are many coefficients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import get_lapack_funcs

from rpil.numerics.blocks import gradient, hessian_product, linear, log_softmax
from rpil.numerics.types import Array, Float

PRECONDITIONER_MIN_STEPS = 4096
"""Steps in the subsample of a preconditioner, at least; and at least four a feature."""

PRECONDITIONER_PRODUCTS = 40
"""Hessian products after which the preconditioner is made again: about as many as it costs."""

FORCING, LOOSE = 0.25, 1e-4
"""Relative residual of a Newton step, and the tolerance of a fit below which it shrinks with the gradient."""

WHOLE_HESSIAN_MAX_COEFFICIENTS = 1_000
"""Coefficients up to which the Hessian is inverted as a whole, not by class blocks."""

HISTORY_LENGTH = 30
"""Points of a `CurvatureHistory` that L-BFGS uses."""

CurvatureHistory = Float[Array, "_ 2 _ _"]
"""T points of an ascent, and the gradient of the objective at each: their differences tell the curvature (L-BFGS)."""


@dataclass(frozen=True)
class NewtonSettings:
    """When `fit_softmax` stops: by default a fit whose likelihoods are compared, and whose policy is not kept."""

    tol: float = 1e-3
    """Largest entry of the gradient, divided by the total weight of the steps, at which the fit has converged."""
    max_iter: int = 15
    """Newton steps at most; 1 is one improving step."""
    max_cg: int = 30
    """Hessian products in each Newton step at most."""


class SoftmaxFit(NamedTuple):
    """Result of `fit_softmax`."""

    weights: Float[Array, "D K"]
    log_proba: Float[Array, "N K"]
    """Log-probabilities of all actions at `weights`."""
    objective: float
    """Penalised negative log-likelihood at `weights`."""
    preconditioner: Preconditioner | None
    """The last one made: good enough for a problem nearby."""


def fit_softmax(
    features: Float[Array, "N D"],
    targets: Float[Array, "N K"],
    penalty: Float[Array, " D"],
    settings: NewtonSettings,
    *,
    start: Float[Array, "D K"] | None = None,
    preconditioner: Preconditioner | None = None,
) -> SoftmaxFit:
    """Minimise -sum_nk T_nk log softmax(x_n W)_k + 1/2 sum_dk penalty_d W_dk^2, to no more than it is at `start`.

    The sum of a row of the non-negative `targets` T is the weight of the step; a constant feature has penalty 0;
    `start` is zero by default; a `preconditioner` of a problem nearby serves the first Newton steps.
    """
    ridge, weight = penalty[:, None], targets.sum(axis=1)
    scale = max(float(weight.sum()), np.finfo(float).tiny)
    weights = np.zeros((features.shape[1], targets.shape[1])) if start is None else np.array(start, dtype=float)
    weights -= weights.mean(axis=1, keepdims=True)  # which all actions share, no step changes
    logits = linear(features, weights)
    log_proba = log_softmax(logits)
    objective, n_products = _objective(log_proba, targets, weights, ridge), 0
    # Directions need fewer digits than slopes, unless the fit goes on to many.
    seen = features if settings.tol < 1e-5 else features.astype(np.float32, copy=False)

    for n_iter in range(settings.max_iter + 1):
        proba = np.exp(log_proba)
        slope = gradient(features, weight[:, None] * proba - targets) + ridge * weights
        norm = float(np.abs(slope).max()) / scale
        if norm <= settings.tol or n_iter == settings.max_iter:
            return SoftmaxFit(weights, log_proba, objective, preconditioner)
        if preconditioner is None or n_products > PRECONDITIONER_PRODUCTS:
            preconditioner, n_products = Preconditioner(features, proba, weight, penalty), 0
        step, n = _newton_direction(seen, proba, weight, ridge, slope, preconditioner, settings)
        n_products += n

        # Logits move on a line, so that a trial length costs no pass over the features.
        step_logits, descent, length = linear(features, step), float((slope * step).sum()), 1.0
        while True:
            trial = weights + length * step
            trial_log_proba = log_softmax(logits + length * step_logits)
            trial_objective = _objective(trial_log_proba, targets, trial, ridge)
            if trial_objective <= objective + 1e-4 * length * descent:
                break
            length *= 0.5
            if length < 1e-10:  # only rounding is left to gain
                return SoftmaxFit(weights, log_proba, objective, preconditioner)
        weights, log_proba, objective = trial, trial_log_proba, trial_objective
        logits = logits + length * step_logits
    raise AssertionError("unreachable")


def _objective(log_proba: Array, targets: Array, weights: Array, ridge: Array) -> float:
    return float(0.5 * (ridge * weights**2).sum() - np.einsum("nk,nk->", targets, log_proba, dtype=float))


def _newton_direction(
    features: Array,
    proba: Array,
    weight: Array,
    ridge: Array,
    slope: Array,
    precondition: Preconditioner,
    settings: NewtonSettings,
) -> tuple[Array, int]:
    """Solve H step = -slope roughly, by n products; the residual shrinks with the slope (Eisenstat-Walker)."""
    proba, weight = (a.astype(features.dtype, copy=False) for a in (proba, weight))
    step, residual = np.zeros_like(slope), -slope
    direction = preconditioned = precondition(residual)
    energy = first = float((residual * preconditioned).sum())
    scale = max(float(weight.sum(dtype=float)), np.finfo(float).tiny)
    forcing = FORCING if settings.tol >= LOOSE else min(FORCING, np.sqrt(np.sqrt(first / scale)))
    n_products = 0
    for n_products in range(1, settings.max_cg + 1):  # noqa: B007
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
    return (step if step.any() else -slope), n_products


def lbfgs_step(
    history: CurvatureHistory, precondition: Callable[[Float[Array, "D K"]], Float[Array, "D K"]]
) -> Float[Array, "D K"]:
    """Ascent step from the last point of `history`, by the two loops of L-BFGS (Nocedal 1980).

    `precondition` applies the inverse Hessian with which the loops begin.
    """
    moves = np.diff(history, axis=0)
    pairs = [(step, -change, -float((step * change).sum())) for step, change in moves]
    pairs = [pair for pair in pairs if pair[2] > 0.0]
    rest, factors = history[-1, 1], []
    for step, decrease, curvature in reversed(pairs):
        factors.append(float((step * rest).sum()) / curvature)
        rest = rest - factors[-1] * decrease
    ascent = precondition(rest)
    for (step, decrease, curvature), factor in zip(pairs, reversed(factors), strict=True):
        ascent = ascent + (factor - float((decrease * ascent).sum()) / curvature) * step
    return ascent


class Preconditioner:
    """Inverse of the Hessian, or of its class blocks X^T diag(s p_k (1 - p_k)) X + penalty where it has more than
    `WHOLE_HESSIAN_MAX_COEFFICIENTS` rows, from an even subsample of the steps.

    `proba` are the probabilities p of the policy and `weight` the weights s of the steps. `unseen_curvature` is given
    for a sample of the data, whose Hessian serves many passes: the curvature that a direction may have in all data
    although the sample has none there. Then all steps are used.
    """

    def __init__(
        self,
        features: Float[Array, "N D"],
        proba: Float[Array, "N K"],
        weight: Float[Array, " N"],
        penalty: Float[Array, " D"],
        unseen_curvature: float | None = None,
    ) -> None:
        self.unseen_curvature = unseen_curvature
        of_sample = bool(unseen_curvature)
        n_steps, n_features = features.shape
        stride = 1 if of_sample else max(1, n_steps // max(PRECONDITIONER_MIN_STEPS, 4 * n_features))
        x, p, s = features[::stride], proba[::stride], stride * weight[::stride]
        if p.shape[1] <= n_features and n_features * p.shape[1] <= WHOLE_HESSIAN_MAX_COEFFICIENTS:
            hessian = _whole_hessian(x.astype(float, copy=False) if of_sample else x, p, s)
            # A shift of all actions changes nothing: it gets a curvature, or the inverse blows rounding up.
            n_actions = p.shape[1]
            shift = np.full((n_actions, n_actions), np.diag(hessian).max() / n_actions)
            hessian = (hessian + np.kron(shift, np.eye(n_features)))[None]
            penalty = np.tile(penalty, n_actions)
        else:
            root = np.sqrt(s[:, None] * p * np.maximum(1 - p, 0.0)).astype(x.dtype, copy=False)
            weighted = (x * root[:, k : k + 1] for k in range(p.shape[1]))
            hessian = np.stack([y.T @ y for y in weighted]).astype(float)  # takes half of X^T Y
        floor = 1e-9 if of_sample and len(hessian) == 1 else max(1e-8, 100 * np.finfo(x.dtype).eps)
        diagonal = np.einsum("kdd->kd", hessian)
        # The floor keeps a class that the subsample hardly sees invertible, and is above the product's rounding.
        diagonal += penalty + floor * (1e-8 + diagonal.max(axis=1, keepdims=True))
        if of_sample and len(hessian) > 1:
            # Class blocks underestimate the curvature between two actions by up to a half: steps of 2/3 of their length
            # are never far too long nor far too short.
            hessian *= 1.5
        self.inverse = _inverses(hessian if of_sample else hessian.astype(x.dtype, copy=False))
        self.hessian = hessian if of_sample else None

    def __call__(self, residual: Float[Array, "D K"], radius: float = np.inf) -> Float[Array, "D K"]:
        """The step H^-1 residual; with a finite radius, (H + c I)^-1 residual without an entry above the radius.

        c begins at `unseen_curvature` / `radius` and is quadrupled until the step is short enough.
        """
        n_features, n_actions = residual.shape
        blocks = residual.T.reshape(len(self.inverse), -1, 1)

        def solve(inverse: Array) -> Array:
            return np.asarray((inverse @ blocks.astype(inverse.dtype, copy=False)).reshape(n_actions, n_features).T)

        if radius == np.inf:
            return solve(self.inverse)
        assert self.hessian is not None
        assert self.unseen_curvature is not None
        identity, c = np.eye(blocks.shape[1]), self.unseen_curvature / radius
        while np.abs(step := solve(_inverses(self.hessian + c * identity))).max() > radius:
            c *= 4.0
        return step


def _inverses(hessian: Array) -> Array:
    """The inverses (B, D, D) of positive definite matrices, in half of the time of `numpy.linalg.inv` and less."""
    (potrf, potri), inverses = get_lapack_funcs(("potrf", "potri"), (hessian,)), np.empty_like(hessian)
    for each, inverse in zip(hessian, inverses, strict=True):
        factor, failed = potrf(each.T, lower=1)
        lower = np.linalg.inv(each) if failed else potri(factor, lower=1)[0]  # not positive: but for rounding
        inverse[:] = np.tril(lower) + np.tril(lower, -1).T
    return inverses


def _whole_hessian(features: Array, proba: Array, weight: Array) -> Array:
    """The Hessian (K D, K D) with the blocks X^T diag(s p_k (1[k = l] - p_l)) X; each row of blocks sums to 0."""
    n_features, n_actions = features.shape[1], proba.shape[1]
    hessian = np.zeros((n_actions, n_features, n_actions, n_features))
    for k in range(n_actions):
        for j in range(k):
            scaled = features * np.sqrt(weight * proba[:, k] * proba[:, j])[:, None].astype(features.dtype)
            shared = scaled.T @ scaled  # takes half of X^T Y
            hessian[k, :, j] = hessian[j, :, k] = -shared
            hessian[k, :, k] += shared
            hessian[j, :, j] += shared
    return hessian.reshape(n_actions * n_features, -1)
