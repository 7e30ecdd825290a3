"""The softmax policy, pi(k|s) = softmax(phi(s)^T Lambda)_k (eq. 3 of the paper)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.numerics.blocks import Sums, at_actions, linear, log_softmax, one_hot, softmax_pass
from rpil.numerics.newton import (
    HISTORY_LENGTH,
    CurvatureHistory,
    NewtonSettings,
    Preconditioner,
    fit_softmax,
    lbfgs_step,
)
from rpil.numerics.types import Array, Float, Int

PRECONDITIONER_FITS = 10
"""Warm-started fits that use one preconditioner: the steps of EM are small."""

UNSEEN_CURVATURE = 0.25
"""Largest curvature, a step, of a direction in which a sample has none: that of one step on a scaled column."""


@stored(weights="F+1 K", ridge="F+1")
@dataclass(frozen=True, eq=False)
class SoftmaxPolicy:
    """pi(k|s) = softmax(phi(s)^T Lambda)_k, for a design matrix whose last column is the constant.

    A fit maximises sum_n w_n log pi(a_n|s_n) - 1/2 sum_dk ridge_d Lambda_dk^2.
    """

    weights: Float[Array, "D K"]
    """Coefficients Lambda, the intercepts in the last row."""
    ridge: Float[Array, " D"]
    """Penalty on the squares of each feature's coefficients, 0 for the constant."""
    _preconditioner: Preconditioner | None = None
    _age: int = 0

    @classmethod
    def zero(cls, n_actions: int, ridge: Float[Array, " D"]) -> SoftmaxPolicy:
        """The uniform policy."""
        return cls(np.zeros((len(ridge), n_actions)), ridge)

    def outputs(self, features: Float[Array, "N D"]) -> Float[Array, "N K"]:
        """log pi(k|s) of all actions."""
        return log_softmax(linear(features, self.weights))

    def log_prob(self, outputs: Float[Array, "N K"], actions: Int[Array, " N"]) -> Float[Array, " N"]:
        """log pi(a_n|s_n) of the actions taken, given the log-probabilities of all."""
        return at_actions(outputs, actions)

    def fit(
        self,
        data: FitData,
        weight: Float[Array, " N"],
        soft_targets: Float[Array, "N K"] | None = None,
        *,
        tol: float = 1e-6,
        max_iter: int = 100,
        max_cg: int = 200,
    ) -> tuple[SoftmaxPolicy, Float[Array, "N K"]]:
        """The policy for the weighted actions taken, plus `soft_targets` if given, and its log-probabilities."""
        targets = one_hot(data.actions, weight, self.weights.shape[1])
        if soft_targets is not None:
            targets += soft_targets
        reuse = self._preconditioner if self._age < PRECONDITIONER_FITS else None
        settings = NewtonSettings(tol, max_iter, max_cg)
        fit = fit_softmax(data.features, targets, self.ridge, settings, start=self.weights, preconditioner=reuse)
        age = self._age + 1 if fit.preconditioner is reuse else 0
        return SoftmaxPolicy(fit.weights, self.ridge, fit.preconditioner, age), fit.log_proba

    def with_preconditioner(
        self, data: FitData, weight: Float[Array, " N"], ridge: Float[Array, " D"], factor: float
    ) -> tuple[SoftmaxPolicy, Preconditioner]:
        """The policy with this ridge, and the Hessian of data with `factor` times the weight of this sample."""
        proba = np.exp(self.outputs(data.features))
        hessian = Preconditioner(data.features, proba, factor * weight, ridge, UNSEEN_CURVATURE * factor)
        return SoftmaxPolicy(self.weights, ridge), hessian

    def collect_suff_stats(self, features: Array, actions: Array, weight: Array) -> tuple[Array, Sums]:
        """log pi of the actions taken, and the gradient of the log-likelihood, (D, K), in one reading."""
        taken, slope = softmax_pass(features, self.weights, actions, weight)
        return taken, (slope - slope.mean(axis=1, keepdims=True),)  # what all actions share is rounding

    def m_step(
        self, statistics: Sums, radius: float, preconditioner: Preconditioner | None, history: CurvatureHistory
    ) -> tuple[SoftmaxPolicy, CurvatureHistory]:
        """One L-BFGS step, given the sums over all steps of the data, and the history with this point.

        No coefficient moves by more than `radius`, which is finite where an unlimited step lowered the objective.
        """
        assert preconditioner is not None
        # Rows contiguous, as arrays are kept: the order in which an array is summed shows in the last bit.
        history = np.array([*history[-HISTORY_LENGTH:], (self.weights, self.penalised_gradient(statistics))])
        step = lbfgs_step(history, preconditioner if len(history) > 1 else partial(preconditioner, radius=radius))
        step *= min(1.0, radius / max(float(np.abs(step).max()), 1e-300))
        return SoftmaxPolicy(self.weights + step, self.ridge), history

    def gradient_norm(self, statistics: Sums) -> float:
        """Largest entry of the gradient of the penalised log-likelihood."""
        return float(np.abs(self.penalised_gradient(statistics)).max())

    def penalised_gradient(self, statistics: Sums) -> Float[Array, "D K"]:
        """The gradient of the penalised log-likelihood."""
        return np.asarray(statistics[0] - self.ridge[:, None] * self.weights)

    def with_temperature(self, temperature: float) -> SoftmaxPolicy:
        """The policy with its logits multiplied by `temperature`: surer above 1, less sure below."""
        return SoftmaxPolicy(temperature * self.weights, self.ridge)

    def penalty(self) -> float:
        """Penalty that the ridge subtracts from the log-likelihood."""
        return float(0.5 * (self.ridge[:, None] * self.weights**2).sum())
