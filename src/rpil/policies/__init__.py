"""Policies: what an expert does in a state."""

from __future__ import annotations

from typing import Protocol, Self

from rpil.passes import Array
from rpil.policies.softmax import SoftmaxPolicy

__all__ = ["Policy", "SoftmaxPolicy"]


class Policy(Protocol):
    """What EM needs of a policy; instances are immutable."""

    def log_proba(self, features: Array) -> Array:
        """log pi(k|s) of all actions, (N, K)."""

    def fit(
        self, features: Array, targets: Array, *, tol: float = ..., max_iter: int = ..., max_cg: int = ...
    ) -> tuple[Self, Array]:
        """A policy that explains soft `targets` (N, K) no worse, and its log-probabilities (N, K).

        A row of `targets` sums to the weight of the step. ``max_iter=1`` asks for one improving step.
        """

    def penalty(self) -> float:
        """What regularisation takes off the log-likelihood."""
