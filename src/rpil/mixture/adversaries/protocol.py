"""Protocol of an adversary: the probability of the action taken, the posterior of the action that was intended, and
its own parameters given its steps."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from rpil.data.fit_data import FitData
from rpil.numerics.types import Array, Float
from rpil.policies.linear import Actions, Outputs


@runtime_checkable
class Adversary(Protocol):
    """A model psi(a|s) of the actions of a bad demonstrator; instances are immutable.

    A subclass inherits an adversary without parameters, whose steps say nothing about the expert's policy.
    """

    @property
    def name(self) -> str:
        """As in `rpil.mixture.adversaries.named.ADVERSARIES`."""

    def log_prob(self, features: Float[Array, "N D"], outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        """log psi(a_n|s_n) of the actions taken, where the expert's policy has these `outputs`."""

    def intended_action_proba(self, outputs: Outputs, actions: Actions) -> Float[Array, "N K"] | None:
        """P(intended action | action taken, state) of an adversary that intends the expert's action and takes another;
        None where its steps say nothing about the expert's policy."""
        return None

    def fit(self, data: FitData, outputs: Outputs, weight: Float[Array, " N"]) -> Adversary:
        """The adversary after its M-step on weighted steps: it explains them no worse."""
        return self

    def log_prior(self) -> float:
        """Log-density of the prior of its own parameters, less a constant: a term of the objective."""
        return 0.0
