"""Policies: what an expert does in a state."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from rpil.data.fit_data import FitData
from rpil.numerics.blocks import Sums
from rpil.numerics.types import Array


@runtime_checkable
class CrossFittedPolicy(Protocol):
    """A policy that is fitted once for each fold, so that its outputs for the steps of a fit are held out."""

    def outputs(self, features: Array) -> Array:
        """What the policy says of states, (N, ...)."""

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        """log pi(a_n|s_n) of the actions taken, (N,)."""

    def fit(self, data: FitData, weight: Array) -> tuple[CrossFittedPolicy, Array]:
        """The policy fitted to weighted steps, and its held-out outputs for them."""

    def fit_all(self, data: FitData, weight: Array) -> CrossFittedPolicy:
        """The policy fitted to all weighted steps, without folds."""


@runtime_checkable
class Policy(Protocol):
    """What a fit needs of a policy; instances are immutable.

    A policy's *outputs* are what it says of each step before the action is looked at: the log-probabilities of all
    actions (N, K), or the means of the actions' distribution (N, A). A fit returns them with the policy.
    """

    def outputs(self, features: Array) -> Array:
        """What the policy says of states, (N, ...)."""

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        """log pi(a_n|s_n) of the actions taken, (N,): a probability, or a density."""

    def fit(
        self,
        data: FitData,
        weight: Array,
        soft_targets: Array | None = None,
        *,
        tol: float = ...,
        max_iter: int = ...,
        max_cg: int = ...,
    ) -> tuple[Policy, Array]:
        """A policy that explains the steps, each counted with `weight` (N,), no worse; and its outputs for them.

        A `soft_targets` is what the adversary's steps teach besides, as `Adversary.intended` gives it times their
        weight. ``max_iter=1`` asks for one improving step.
        """

    def penalty(self) -> float:
        """What regularisation takes off the log-likelihood."""

    def with_temperature(self, temperature: float) -> Policy:
        """The same, surer above 1 and less sure below, where a policy knows how."""


@runtime_checkable
class AdditivePolicy(Policy, Protocol):
    """A policy that can also learn from sums over parts of the data, which may lie in many places."""

    def with_preconditioner(
        self, data: FitData, weight: Array, ridge: Array, factor: float
    ) -> tuple[AdditivePolicy, Any]:
        """Ready for sums over `factor` times as many steps as these, weighted, with `ridge` (D,) for all of them; and a
        Hessian, or whatever else helps to improve."""

    def collect_suff_stats(self, data: FitData, weight: Array) -> tuple[Array, Sums]:
        """log pi of the actions taken, (N,), and the sums over weighted steps that `m_step` needs."""

    def m_step(self, statistics: Sums, radius: float, hessian: Any, path: Array) -> tuple[AdditivePolicy, Array]:
        """The policy after one improving step, given the sums over all steps of the data, and what it remembers of the
        way to here, see `rpil.numerics.newton.lbfgs_step`; a finite `radius` says that a step without it went down,
        and how far a coefficient may move."""

    def gradient_norm(self, statistics: Sums) -> float:
        """How far from the best it still is: the largest entry of the gradient, or nats where these say more."""
