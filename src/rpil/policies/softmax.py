"""The softmax policy, pi(k|s) = softmax(phi(s)^T Lambda)_k (eq. 3 of the paper)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rpil.passes import Array, linear, log_softmax
from rpil.solvers import fit_softmax


@dataclass(frozen=True, eq=False)
class SoftmaxPolicy:
    """A linear softmax policy over a design matrix whose last column is the constant.

    Attributes
    ----------
    weights : (D, K) array
        Coefficients, the intercepts in the last row.
    ridge : float
        Penalty on every coefficient but the intercepts: 1/C as scikit-learn means it (for two actions scikit-learn
        penalises the difference of the two columns once, which is twice the penalty on each).
    """

    weights: Array
    ridge: float

    @classmethod
    def zero(cls, n_features: int, n_actions: int, ridge: float) -> SoftmaxPolicy:
        """The policy that prefers nothing."""
        return cls(np.zeros((n_features, n_actions)), ridge)

    def log_proba(self, features: Array) -> Array:
        """log pi(k|s) of all actions, (N, K)."""
        return log_softmax(linear(features, self.weights.astype(features.dtype, copy=False)))

    def fit(
        self, features: Array, targets: Array, *, tol: float = 1e-6, max_iter: int = 100, max_cg: int = 200
    ) -> tuple[SoftmaxPolicy, Array]:
        """The policy that explains soft `targets` (N, K) best, from here on, and its log-probabilities (N, K)."""
        fit = fit_softmax(
            features, targets, self._penalty(), start=self.weights, tol=tol, max_iter=max_iter, max_cg=max_cg
        )
        return replace(self, weights=fit.weights), fit.log_proba

    def penalty(self) -> float:
        """What the ridge takes off the log-likelihood."""
        return float(0.5 * (self._penalty()[:, None] * self.weights**2).sum())

    def _penalty(self) -> Array:
        n_features, n_actions = self.weights.shape
        penalty = np.full(n_features, self.ridge * (2.0 if n_actions == 2 else 1.0))
        penalty[-1] = 0.0
        return penalty
