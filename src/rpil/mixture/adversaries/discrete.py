"""Adversaries with discrete actions, psi(k|s). Derivations: "Adversaries" in docs/model.md; option numbers are the
paper's."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import logsumexp

from rpil.data.archive import stored
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.mixture.adversaries.protocol import Fixed
from rpil.numerics.types import Array


@stored()
@dataclass(frozen=True)
class Constant(Fixed):
    """psi = 1 (option 1): no distribution, so everything turns adversary without a prior that says otherwise."""

    name: str = "constant"

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        return np.zeros(len(actions))


@stored()
@dataclass(frozen=True)
class Uniform(Fixed):
    """psi = 1/K: presses any key."""

    name: str = "uniform"

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        return np.full(len(actions), -np.log(outputs.shape[1]))


@stored(log_frequency="K")
@dataclass(frozen=True, eq=False)
class Marginal(Fixed):
    """psi(k) = f_k: presses keys at its own favourite frequencies, whatever the state.

    The frequencies have a Dirichlet prior worth one step of each action, so that none is ever impossible.
    """

    log_frequency: Array
    name: str = "marginal"

    @classmethod
    def start(cls, n_actions: int) -> Marginal:
        return cls(np.full(n_actions, -np.log(n_actions)))

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        return self.log_frequency[actions]

    def fit(self, data: FitData, outputs: Array, weight: Array) -> Marginal:
        counts = 1.0 + np.bincount(data.actions, weight, minlength=len(self.log_frequency))
        return replace(self, log_frequency=np.log(counts / counts.sum()))

    def log_prior(self) -> float:
        return float(self.log_frequency.sum())


@stored()
@dataclass(frozen=True)
class Complement(Fixed):
    """psi = 1 - pi (option 3, the paper's), or (1 - pi) / (K - 1), which is a distribution for every K.

    1 - pi_k is a sum over the other actions, so its logarithm is a logsumexp and never a clipped difference.
    """

    normalised: bool = False

    @property
    def name(self) -> str:
        return "normalised complement" if self.normalised else "complement"

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        others = outputs.copy()
        np.put_along_axis(others, actions[:, None], -np.inf, axis=1)
        scale = np.log(outputs.shape[1] - 1) if self.normalised else 0.0
        return logsumexp(others, 1) - scale

    def intended(self, outputs: Array, actions: Array) -> Array | None:
        others = outputs.copy()
        np.put_along_axis(others, actions[:, None], -np.inf, axis=1)
        others -= others.max(axis=1, keepdims=True)
        proba = np.exp(others)
        return proba / proba.sum(axis=1, keepdims=True)


@stored(log_matrix="K K")
@dataclass(frozen=True, eq=False)
class Confusion(Fixed):
    """psi(k|s) = sum_j pi(j|s) C[j, k]: means the expert's action j and presses k.

    C (K, K) is row-stochastic, given or learned. Learned rows have a Dirichlet prior of `pseudo_count` steps spread
    evenly over the actions on top of the flat one.
    """

    log_matrix: Array
    learned: bool = True
    pseudo_count: float = 1.0
    name: str = field(default="confusion")

    @classmethod
    def given(cls, matrix: ArrayLike) -> Confusion:
        """A known confusion: row j says how often each action is pressed when j is meant.

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
        """Half-way between pressing any key and pressing any but the expert's."""
        anything = np.full((n_actions, n_actions), 1.0 / n_actions)
        others = (1.0 - np.eye(n_actions)) / (n_actions - 1)
        return cls(np.log(0.5 * anything + 0.5 * others))

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        return logsumexp(outputs + self.log_matrix.T[actions], 1)

    def intended(self, outputs: Array, actions: Array) -> Array | None:
        joint = outputs + self.log_matrix.T[actions]
        total = logsumexp(joint, 1)[:, None]
        return np.exp(
            joint - np.where(np.isfinite(total), total, 0.0)
        )  # an action of probability 0 has no intended action

    def fit(self, data: FitData, outputs: Array, weight: Array) -> Confusion:
        if not self.learned:
            return self
        intended = weight[:, None] * self.intended(outputs, data.actions)
        expected = [intended[data.actions == k].sum(axis=0) for k in range(len(self.log_matrix))]
        counts = self.pseudo_count + np.stack(expected, axis=1)
        return replace(self, log_matrix=np.log(counts / counts.sum(axis=1, keepdims=True)))

    def log_prior(self) -> float:
        return self.pseudo_count * float(self.log_matrix.sum()) if self.learned else 0.0
