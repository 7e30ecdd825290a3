"""Adversaries with discrete actions, psi(k|s); docs/model.md has the formulas, and option numbers are the paper's."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import logsumexp, softmax

from rpil.data.archive import stored
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.mixture.adversaries.protocol import Adversary
from rpil.numerics.types import Array, Float
from rpil.policies.linear import Actions, Outputs


@stored()
@dataclass(frozen=True)
class Constant(Adversary):
    """psi = 1 (option 1). It is no distribution: without a strong prior every demonstration is an adversary's."""

    name: str = "constant"

    def log_prob(self, features: Float[Array, "N D"], outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        return np.zeros(len(actions))


@stored()
@dataclass(frozen=True)
class Uniform(Adversary):
    """psi = 1/K: every action is as likely as any other."""

    name: str = "uniform"

    def log_prob(self, features: Float[Array, "N D"], outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        return np.full(len(actions), -np.log(outputs.shape[1]))


@stored(log_frequency="K")
@dataclass(frozen=True, eq=False)
class Marginal(Adversary):
    """psi(k) = f_k: the frequencies of the actions, whatever the state.

    They have a Dirichlet prior worth one step of each action, so that no action is impossible.
    """

    log_frequency: Float[Array, " K"]
    name: str = "marginal"

    @classmethod
    def start(cls, n_actions: int) -> Marginal:
        """Equal frequencies."""
        return cls(np.full(n_actions, -np.log(n_actions)))

    def log_prob(self, features: Float[Array, "N D"], outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        return self.log_frequency[actions]

    def fit(self, data: FitData, outputs: Outputs, weight: Float[Array, " N"]) -> Marginal:
        counts = 1.0 + np.bincount(data.actions, weight, minlength=len(self.log_frequency))
        return replace(self, log_frequency=np.log(counts / counts.sum()))

    def log_prior(self) -> float:
        return float(self.log_frequency.sum())


@stored()
@dataclass(frozen=True)
class Complement(Adversary):
    """psi = 1 - pi (option 3, the paper's), or (1 - pi) / (K - 1), which is a distribution for every K.

    1 - pi_k is the sum over the other actions, so its logarithm is a logsumexp and never a clipped difference.
    """

    normalised: bool = False

    @property
    def name(self) -> str:
        return "normalised complement" if self.normalised else "complement"

    def log_prob(self, features: Float[Array, "N D"], outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        scale = np.log(outputs.shape[1] - 1) if self.normalised else 0.0
        return np.asarray(logsumexp(_without_taken(outputs, actions), 1) - scale)

    def intended_action_proba(self, outputs: Outputs, actions: Actions) -> Float[Array, "N K"]:
        return np.asarray(softmax(_without_taken(outputs, actions), 1))


def _without_taken(outputs: Array, actions: Array) -> Array:
    """Log-probabilities (N, K) with that of the action taken set to minus infinity."""
    others = outputs.copy()
    np.put_along_axis(others, actions[:, None], -np.inf, axis=1)
    return others


@stored(log_matrix="K K")
@dataclass(frozen=True, eq=False)
class Confusion(Adversary):
    """psi(k|s) = sum_j pi(j|s) C[j, k]: the adversary intends the expert's action j and takes action k.

    Each row of C (K, K) is a distribution, given or learned. A learned row has a Dirichlet prior worth one step of each
    action, so that no action is impossible.
    """

    log_matrix: Float[Array, "K K"]
    learned: bool = True
    name: str = "confusion"

    @classmethod
    def given(cls, matrix: ArrayLike) -> Confusion:
        """Take a known confusion matrix: row j says how often each action is taken if j is intended.

        Raises
        ------
        DataError
            Where the rows are not distributions over the same actions.
        """
        rows = np.asarray(matrix, dtype=float)
        square = rows.ndim == 2 and rows.shape[0] == rows.shape[1]
        if not square or (rows < 0).any() or not np.allclose(rows.sum(axis=1), 1.0):
            raise DataError("A confusion matrix is square and its rows are distributions; divide each by its sum.")
        with np.errstate(divide="ignore"):
            return cls(np.log(rows), learned=False)

    @classmethod
    def start(cls, n_actions: int) -> Confusion:
        """The mean of two adversaries: any action, and any action but the expert's."""
        uniform = np.full((n_actions, n_actions), 1.0 / n_actions)
        complement = (1.0 - np.eye(n_actions)) / (n_actions - 1)
        return cls(np.log(0.5 * uniform + 0.5 * complement))

    def log_prob(self, features: Float[Array, "N D"], outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        return np.asarray(logsumexp(outputs + self.log_matrix.T[actions], 1))

    def intended_action_proba(self, outputs: Outputs, actions: Actions) -> Float[Array, "N K"]:
        joint = outputs + self.log_matrix.T[actions]
        total = logsumexp(joint, 1)[:, None]
        # An action of probability 0 has no intended action: its row is zero.
        return np.asarray(np.exp(joint - np.where(np.isfinite(total), total, 0.0)))

    def fit(self, data: FitData, outputs: Outputs, weight: Float[Array, " N"]) -> Confusion:
        if not self.learned:
            return self
        intended = weight[:, None] * self.intended_action_proba(outputs, data.actions)
        expected = [intended[data.actions == k].sum(axis=0) for k in range(len(self.log_matrix))]
        counts = 1.0 + np.stack(expected, axis=1)
        return replace(self, log_matrix=np.log(counts / counts.sum(axis=1, keepdims=True)))

    def log_prior(self) -> float:
        return float(self.log_matrix.sum()) if self.learned else 0.0
