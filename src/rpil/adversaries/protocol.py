"""What EM asks of an adversary.

How likely is the action taken, which action did the adversary *intend* (so that its steps can teach the policy), and
what are its own parameters given its steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from rpil.passes import Array, Sums
from rpil.problem import Problem


class Adversary(Protocol):
    """What EM needs of an adversary; instances are immutable."""

    @property
    def name(self) -> str:
        """As in `ADVERSARIES`."""

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        """log psi(a_n|s_n) of the actions taken, (N,), where the policy has these `outputs` (N, ...)."""

    def intended(self, outputs: Array, actions: Array) -> Array | None:
        """P(intended action | action taken, state), (N, K); None where the steps teach the policy nothing."""

    def fit(self, problem: Problem, outputs: Array, weight: Array) -> Self:
        """The adversary that explains the steps no worse, each counted with `weight` (N,)."""

    def primed(self, problem: Problem, weight: Array, ridge: Array, factor: float) -> Self:
        """Ready for sums over `factor` times as many steps, see `rpil.policies.Policy`."""

    def like(self, primed: Self) -> Self:
        """Ready for the same sums as another one."""

    def statistics(self, problem: Problem, outputs: Array, weight: Array) -> Sums:
        """What some of the steps tell, as sums."""

    def improved(self, statistics: Sums, radius: float = np.inf) -> Self:
        """The adversary that explains all steps no worse, given the statistics of all; `radius` as for policies."""

    def log_prior(self) -> float:
        """What the prior on its own parameters adds to the objective."""


@dataclass(frozen=True)
class Fixed:
    """An adversary with nothing to learn, and nothing to teach; what learns overrides `statistics` and `improved`."""

    def intended(self, outputs: Array, actions: Array) -> Array | None:
        return None

    def fit(self, problem: Problem, outputs: Array, weight: Array) -> Self:
        return self.improved(self.statistics(problem, outputs, weight))

    def primed(self, problem: Problem, weight: Array, ridge: Array, factor: float) -> Self:
        return self

    def like(self, primed: Self) -> Self:
        return self

    def statistics(self, problem: Problem, outputs: Array, weight: Array) -> Sums:
        return ()

    def improved(self, statistics: Sums, radius: float = np.inf) -> Self:
        return self

    def log_prior(self) -> float:
        return 0.0
