"""Protocol of a policy pi(a|s), as the other rooms need it."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from rpil.data.fit_data import FitData
from rpil.numerics.types import Array, Float, Num

Outputs = Float[Array, "N O"]
"""The distribution of the actions in each of N states: log-probabilities of all K actions, or means of A numbers."""

Actions = Num[Array, "N ..."]
"""The actions taken: codes (N,), or numbers (N, A)."""


@runtime_checkable
class ActionModel(Protocol):
    """The distribution of the actions in each state."""

    def outputs(self, features: Num[Array, "N D"]) -> Outputs:
        """The outputs in each state, before the action is looked at; of several models their mean."""

    def log_prob(self, outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        """log pi(a_n|s_n) of the actions taken: log-probabilities, or log-densities."""


@runtime_checkable
class CrossFittedPolicy(ActionModel, Protocol):
    """A policy whose `fit` returns held-out outputs: those of a model that was fitted without the demonstration."""

    def fit(self, data: FitData, weight: Float[Array, " N"]) -> tuple[CrossFittedPolicy, Outputs]:
        """A policy fitted to weighted steps, one model for each fold of demonstrations, and its held-out outputs."""

    def fit_all(self, data: FitData, weight: Float[Array, " N"]) -> CrossFittedPolicy:
        """The policy of one model that is fitted to all weighted steps, for predicting."""


@runtime_checkable
class Policy(ActionModel, Protocol):
    """A policy that EM can fit; instances are immutable."""

    def fit(
        self,
        data: FitData,
        weight: Float[Array, " N"],
        soft_targets: Float[Array, "N K"] | None = None,
        *,
        tol: float = ...,
        max_iter: int = ...,
        max_cg: int = ...,
    ) -> tuple[Policy, Outputs]:
        """A policy whose penalised log-likelihood of the weighted steps is no lower, and its outputs for them.

        `soft_targets` are added to the targets: the probabilities of the actions that the adversary intended
        (`Adversary.intended_action_proba`), times their weights. ``max_iter=1`` is one improving step.
        """

    def penalty(self) -> float:
        """Penalty that regularisation subtracts from the log-likelihood."""

    def with_temperature(self, temperature: float) -> Policy:
        """The policy with its logits multiplied by `temperature`; a policy without logits is unchanged."""
