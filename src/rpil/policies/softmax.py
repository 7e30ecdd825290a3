"""The softmax policy, pi(k|s) = softmax(phi(s)^T Lambda)_k (eq. 3 of the paper)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.numerics.blocks import Sums, linear, log_softmax, softmax_pass
from rpil.numerics.newton import HISTORY_LENGTH, NewtonSettings, Preconditioner, fit_softmax, lbfgs_step
from rpil.numerics.types import Array

_PRECONDITIONER_FITS = 10
"""Warm-started fits that one preconditioner serves: the steps of EM are small."""

_UNSEEN = 0.25
"""Largest curvature, for a step, of a direction that a sample has not seen: that of one step on a scaled column."""


def one_hot(actions: Array, weight: Array, n_actions: int) -> Array:
    """Targets (N, K) with `weight` (N,) on the action taken."""
    targets = np.zeros((n_actions, len(actions)))
    targets[actions, np.arange(len(actions))] = weight
    return targets.T


@stored(weights="F+1 K", ridge="F+1")
@dataclass(frozen=True, eq=False)
class SoftmaxPolicy:
    """A linear softmax policy over a design matrix whose last column is the constant.

    Attributes
    ----------
    weights : (D, K) array
        Coefficients, the intercepts in the last row.
    ridge : (D,) array
        Penalty on the squares of each feature's coefficients, 0 for the constant.
    """

    weights: Array
    ridge: Array
    _preconditioner: Preconditioner | None = None
    _age: int = 0

    @classmethod
    def zero(cls, n_actions: int, ridge: Array) -> SoftmaxPolicy:
        """The policy that prefers nothing."""
        return cls(np.zeros((len(ridge), n_actions)), ridge)

    def log_proba(self, features: Array) -> Array:
        """log pi(k|s) of all actions, (N, K)."""
        return log_softmax(linear(features, self.weights))

    outputs = log_proba

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        """log pi(a_n|s_n) of the actions taken, (N,), given the log-probabilities of all."""
        return np.take_along_axis(outputs, actions[:, None], axis=1)[:, 0]

    def fit(
        self,
        data: FitData,
        weight: Array,
        soft_targets: Array | None = None,
        *,
        tol: float = 1e-6,
        max_iter: int = 100,
        max_cg: int = 200,
    ) -> tuple[SoftmaxPolicy, Array]:
        """The policy for actions taken with `weight` (N,), and for soft targets `soft_targets` (N, K) besides; and its
        log-probabilities (N, K)."""
        targets = one_hot(data.actions, weight, self.weights.shape[1])
        if soft_targets is not None:
            targets += soft_targets
        reuse = self._preconditioner if self._age < _PRECONDITIONER_FITS else None
        settings = NewtonSettings(tol, max_iter, max_cg)
        fit = fit_softmax(data.features, targets, self.ridge, settings, start=self.weights, preconditioner=reuse)
        age = self._age + 1 if fit.preconditioner is reuse else 0
        return SoftmaxPolicy(fit.weights, self.ridge, fit.preconditioner, age), fit.log_proba

    def with_preconditioner(
        self, data: FitData, weight: Array, ridge: Array, factor: float
    ) -> tuple[SoftmaxPolicy, Preconditioner]:
        """The same for sums over `factor` times as many steps, and their Hessian as these have it; `ridge` is for all
        of them."""
        proba = np.exp(self.log_proba(data.features))
        hessian = Preconditioner(data.features, proba, factor * weight, ridge, _UNSEEN * factor)
        return SoftmaxPolicy(self.weights, ridge), hessian

    def collect_suff_stats(self, data: FitData, weight: Array) -> tuple[Array, Sums]:
        """log pi of the actions taken, (N,), and the gradient of the log-likelihood, (D, K), in one reading."""
        taken, slope = softmax_pass(data.features, self.weights, data.actions, weight)
        return taken, (slope - slope.mean(axis=1, keepdims=True),)  # what all actions share is rounding

    def m_step(
        self, statistics: Sums, radius: float, hessian: Callable[..., Array], path: Array
    ) -> tuple[SoftmaxPolicy, Array]:
        """One Newton step, and the path with this place."""
        # Rows contiguous, as arrays are kept: the order in which an array is summed shows in the last bit.
        path = np.array([*path[-HISTORY_LENGTH:], (self.weights, self.penalised_gradient(statistics))])
        step = lbfgs_step(path, hessian if len(path) > 1 else partial(hessian, radius=radius))
        step *= min(1.0, radius / max(float(np.abs(step).max()), 1e-300))
        return SoftmaxPolicy(self.weights + step, self.ridge), path

    def gradient_norm(self, statistics: Sums) -> float:
        """Largest entry of the gradient of the penalised log-likelihood."""
        return float(np.abs(self.penalised_gradient(statistics)).max())

    def penalised_gradient(self, statistics: Sums) -> Array:
        """The gradient of the penalised log-likelihood, (D, K)."""
        gradient: Array = statistics[0] - self.ridge[:, None] * self.weights
        return gradient

    def with_temperature(self, temperature: float) -> SoftmaxPolicy:
        """The same order of preferences, surer above 1 and less sure below."""
        return SoftmaxPolicy(temperature * self.weights, self.ridge)

    def penalty(self) -> float:
        """What the ridge takes off the log-likelihood."""
        return float(0.5 * (self.ridge[:, None] * self.weights**2).sum())
