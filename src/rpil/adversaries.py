"""What an adversary does in a state: psi(k|s), one small frozen class each.

Every adversary answers three questions, and EM asks nothing else: how likely is the action taken, which action did the
adversary *intend* (so that its steps can teach the policy), and what are its own parameters given its steps.
Derivations: "Adversaries" in docs/model.md; option numbers are the paper's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from rpil.errors import DataError
from rpil.passes import Array, logsumexp
from rpil.policies import Policy, SoftmaxPolicy


class Adversary(Protocol):
    """What EM needs of an adversary; instances are immutable."""

    @property
    def name(self) -> str:
        """As in `ADVERSARIES`."""

    def log_prob(self, features: Array, log_policy: Array, actions: Array) -> Array:
        """log psi(a_n|s_n) of the actions taken, (N,)."""

    def intended(self, log_policy: Array, actions: Array) -> Array | None:
        """P(intended action | action taken, state), (N, K); None where the steps say nothing about the policy."""

    def fit(self, features: Array, log_policy: Array, actions: Array, weight: Array) -> Self:
        """The adversary that explains the steps no worse, each counted with `weight` (N,)."""

    def log_prior(self) -> float:
        """What the prior on its own parameters adds to the objective."""


@dataclass(frozen=True)
class _Fixed:
    """An adversary with nothing to learn, and nothing to teach."""

    def intended(self, log_policy: Array, actions: Array) -> Array | None:
        return None

    def fit(self, features: Array, log_policy: Array, actions: Array, weight: Array) -> Self:
        return self

    def log_prior(self) -> float:
        return 0.0


@dataclass(frozen=True)
class Constant(_Fixed):
    """psi = 1 (option 1): no distribution, so everything turns adversary without a prior that says otherwise."""

    name: str = "constant"

    def log_prob(self, features: Array, log_policy: Array, actions: Array) -> Array:
        return np.zeros(len(actions))


@dataclass(frozen=True)
class Uniform(_Fixed):
    """psi = 1/K: presses any key."""

    name: str = "uniform"

    def log_prob(self, features: Array, log_policy: Array, actions: Array) -> Array:
        return np.full(len(actions), -np.log(log_policy.shape[1]))


@dataclass(frozen=True, eq=False)
class Marginal(_Fixed):
    """psi(k) = f_k: presses keys at its own favourite frequencies, whatever the state.

    The frequencies have a Dirichlet prior worth one step of each action, so that none is ever impossible.
    """

    log_frequency: Array
    name: str = "marginal"

    @classmethod
    def start(cls, n_actions: int) -> Marginal:
        return cls(np.full(n_actions, -np.log(n_actions)))

    def log_prob(self, features: Array, log_policy: Array, actions: Array) -> Array:
        return self.log_frequency[actions]

    def fit(self, features: Array, log_policy: Array, actions: Array, weight: Array) -> Marginal:
        counts = 1.0 + np.bincount(actions, weight, minlength=len(self.log_frequency))
        return replace(self, log_frequency=np.log(counts / counts.sum()))

    def log_prior(self) -> float:
        return float(self.log_frequency.sum())


@dataclass(frozen=True)
class Complement:
    """psi = 1 - pi (option 3, the paper's), or (1 - pi) / (K - 1), which is a distribution for every K.

    1 - pi_k is a sum over the other actions, so its logarithm is a logsumexp and never a clipped difference.
    """

    normalised: bool = False

    @property
    def name(self) -> str:
        return "normalised complement" if self.normalised else "complement"

    def log_prob(self, features: Array, log_policy: Array, actions: Array) -> Array:
        others = log_policy.copy()
        np.put_along_axis(others, actions[:, None], -np.inf, axis=1)
        scale = np.log(log_policy.shape[1] - 1) if self.normalised else 0.0
        return logsumexp(others, 1) - scale

    def intended(self, log_policy: Array, actions: Array) -> Array | None:
        others = log_policy.copy()
        np.put_along_axis(others, actions[:, None], -np.inf, axis=1)
        others -= others.max(axis=1, keepdims=True)
        proba = np.exp(others)
        return proba / proba.sum(axis=1, keepdims=True)

    def fit(self, features: Array, log_policy: Array, actions: Array, weight: Array) -> Complement:
        return self

    def log_prior(self) -> float:
        return 0.0


@dataclass(frozen=True, eq=False)
class Confusion:
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

    def log_prob(self, features: Array, log_policy: Array, actions: Array) -> Array:
        return logsumexp(log_policy + self.log_matrix.T[actions], 1)

    def intended(self, log_policy: Array, actions: Array) -> Array | None:
        joint = log_policy + self.log_matrix.T[actions]
        total = logsumexp(joint, 1)[:, None]
        return np.exp(joint - np.where(np.isfinite(total), total, 0.0))  # what cannot be pressed was meant by nobody

    def fit(self, features: Array, log_policy: Array, actions: Array, weight: Array) -> Confusion:
        if not self.learned:
            return self
        intended = weight[:, None] * self.intended(log_policy, actions)
        n_actions = len(self.log_matrix)
        counts = np.full((n_actions, n_actions), self.pseudo_count)
        for k in range(n_actions):
            counts[:, k] += intended[actions == k].sum(axis=0)
        return replace(self, log_matrix=np.log(counts / counts.sum(axis=1, keepdims=True)))

    def log_prior(self) -> float:
        return self.pseudo_count * float(self.log_matrix.sum()) if self.learned else 0.0


@dataclass(frozen=True, eq=False)
class OwnPolicy:
    """psi(k|s) = softmax(phi(s)^T Psi)_k (option 2): a policy of its own.

    Symmetric with the expert: which of the two is which must come from labels, the prior or the start.
    """

    policy: Policy
    name: str = "own policy"

    @classmethod
    def start(cls, n_actions: int, ridge: Array) -> OwnPolicy:
        return cls(SoftmaxPolicy.zero(n_actions, ridge))

    def log_prob(self, features: Array, log_policy: Array, actions: Array) -> Array:
        return np.take_along_axis(self.policy.log_proba(features), actions[:, None], axis=1)[:, 0]

    def intended(self, log_policy: Array, actions: Array) -> Array | None:
        return None

    def fit(self, features: Array, log_policy: Array, actions: Array, weight: Array) -> OwnPolicy:
        targets = np.zeros_like(log_policy)
        np.put_along_axis(targets, actions[:, None], weight[:, None], axis=1)
        policy, _ = self.policy.fit(features, targets, max_iter=2, max_cg=20)
        return replace(self, policy=policy)

    def log_prior(self) -> float:
        return -self.policy.penalty()


ADVERSARIES: dict[str, Callable[[int, Array], Adversary]] = {
    "constant": lambda n_actions, ridge: Constant(),
    "uniform": lambda n_actions, ridge: Uniform(),
    "marginal": lambda n_actions, ridge: Marginal.start(n_actions),
    "complement": lambda n_actions, ridge: Complement(),
    "normalised complement": lambda n_actions, ridge: Complement(normalised=True),
    "confusion": lambda n_actions, ridge: Confusion.start(n_actions),
    "own policy": lambda n_actions, ridge: OwnPolicy.start(n_actions, ridge),
}
"""Name -> start of the adversary, given the number of actions and the ridge of each feature."""


def adversary(which: str | Adversary, n_actions: int, ridge: Array) -> Adversary:
    """The adversary called `which` before it has seen data, or `which` itself where it is one already.

    Raises
    ------
    DataError
        If there is none of that name, or a confusion matrix has another number of actions.
    """
    if isinstance(which, Confusion) and len(which.log_matrix) != n_actions:
        size = len(which.log_matrix)
        raise DataError(f"A confusion matrix of {size} x {size} was given for {n_actions} actions; give one row each.")
    if not isinstance(which, str):
        return which
    if which not in ADVERSARIES:
        raise DataError(f"There is no adversary called {which!r}; choose auto, {', '.join(ADVERSARIES)}.")
    return ADVERSARIES[which](n_actions, ridge)
