"""What EM asks of an adversary.

How likely is the action taken, which action did the adversary *intend* (so that its steps can teach the policy), and
what are its own parameters given its steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

from rpil.data.fit_data import FitData
from rpil.numerics.types import Array


@runtime_checkable
class Adversary(Protocol):
    """What EM needs of an adversary; instances are immutable."""

    @property
    def name(self) -> str:
        """As in `ADVERSARIES`."""

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        """log psi(a_n|s_n) of the actions taken, (N,), where the policy has these `outputs` (N, ...)."""

    def intended(self, outputs: Array, actions: Array) -> Array | None:
        """P(intended action | action taken, state), (N, K); None where the steps teach the policy nothing."""

    def fit(self, data: FitData, outputs: Array, weight: Array) -> Adversary:
        """The adversary that explains the steps no worse, each counted with `weight` (N,)."""

    def log_prior(self) -> float:
        """What the prior on its own parameters adds to the objective."""


FixedAdversary = TypeVar("FixedAdversary", bound="Fixed")


@dataclass(frozen=True)
class Fixed:
    """An adversary that learns nothing and whose steps teach the policy nothing."""

    def intended(self, outputs: Array, actions: Array) -> Array | None:
        return None

    def fit(self: FixedAdversary, data: FitData, outputs: Array, weight: Array) -> FixedAdversary:
        return self

    def log_prior(self) -> float:
        return 0.0
