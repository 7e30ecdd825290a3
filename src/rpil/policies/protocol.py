"""What the other rooms need of a policy pi(a|s)."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from rpil.data.fit_data import FitData
from rpil.numerics.blocks import Sums
from rpil.numerics.newton import CurvatureHistory, Preconditioner
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
        """What regularisation subtracts from the log-likelihood."""

    def with_temperature(self, temperature: float) -> Policy:
        """The policy with its logits multiplied by `temperature`; a policy without logits is unchanged."""


@runtime_checkable
class AdditivePolicy(Policy, Protocol):
    """A policy that can also be fitted by sums over parts of the data, which may lie in several places."""

    def with_preconditioner(
        self, data: FitData, weight: Float[Array, " N"], ridge: Float[Array, " D"], factor: float
    ) -> tuple[AdditivePolicy, Preconditioner | None]:
        """From a weighted sample, prepare m-steps on data with `factor` times its weight, and `ridge` for all data.

        Returns the policy with that ridge, and the preconditioner if its `m_step` needs one.
        """

    def collect_suff_stats(self, features: Array, actions: Array, weight: Array) -> tuple[Array, Sums]:
        """log pi of the actions taken, and the sums over weighted steps that `m_step` needs."""

    def m_step(
        self, statistics: Sums, radius: float, preconditioner: Preconditioner | None, history: CurvatureHistory
    ) -> tuple[AdditivePolicy, CurvatureHistory]:
        """The policy after one improving step, given the sums over all steps of the data, and the extended history.

        No coefficient moves by more than `radius`, which is finite where an unlimited step lowered the objective.
        """

    def gradient_norm(self, statistics: Sums) -> float:
        """Distance from the optimum: the largest entry of the gradient, or predicted gains in nats if larger."""
