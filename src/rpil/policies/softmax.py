"""The softmax policy, pi(k|s) = softmax(phi(s)^T Lambda)_k (eq. 3 of the paper)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.passes import Array, linear, log_softmax
from rpil.solvers import Preconditioner, fit_softmax

_PRECONDITIONER_FITS = 10
"""Warm-started fits that one preconditioner serves: EM moves little in so many iterations."""


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

    def fit(
        self, features: Array, targets: Array, *, tol: float = 1e-6, max_iter: int = 100, max_cg: int = 200
    ) -> tuple[SoftmaxPolicy, Array]:
        """The policy that explains soft `targets` (N, K) best, from here on, and its log-probabilities (N, K)."""
        reuse = self._preconditioner if self._age < _PRECONDITIONER_FITS else None
        fit = fit_softmax(
            features,
            targets,
            self.ridge,
            start=self.weights,
            tol=tol,
            max_iter=max_iter,
            max_cg=max_cg,
            preconditioner=reuse,
        )
        age = self._age + 1 if fit.preconditioner is reuse else 0
        return SoftmaxPolicy(fit.weights, self.ridge, fit.preconditioner, age), fit.log_proba

    def tempered(self, temperature: float) -> SoftmaxPolicy:
        """The same order of preferences, surer above 1 and less sure below."""
        return SoftmaxPolicy(temperature * self.weights, self.ridge)

    def penalty(self) -> float:
        """What the ridge takes off the log-likelihood."""
        return float(0.5 * (self.ridge[:, None] * self.weights**2).sum())
