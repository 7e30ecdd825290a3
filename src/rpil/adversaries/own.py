"""An adversary with a policy of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpil.adversaries.protocol import Fixed
from rpil.passes import Array, Sums
from rpil.problem import Problem


@dataclass(frozen=True, eq=False)
class OwnPolicy(Fixed):
    """psi = another policy (option 2): softmax(phi(s)^T Psi)_k, or whatever the expert's is.

    Symmetric with the expert: which of the two is which must come from labels, the prior or the start.
    """

    policy: Any
    name: str = "own policy"

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        return self.policy.log_prob(self.policy.outputs(features), actions)

    def fit(self, problem: Problem, outputs: Array, weight: Array) -> OwnPolicy:
        policy, _ = self.policy.learn(problem, weight, max_iter=2, max_cg=20)
        return replace(self, policy=policy)

    def primed(self, problem: Problem, weight: Array, ridge: Array, factor: float) -> OwnPolicy:
        return replace(self, policy=self.policy.primed(problem, weight, ridge, factor))

    def like(self, primed: OwnPolicy) -> OwnPolicy:
        return replace(self, policy=self.policy.like(primed.policy))

    def statistics(self, problem: Problem, outputs: Array, weight: Array) -> Sums:
        return self.policy.statistics(problem, self.policy.outputs(problem.features), weight)

    def improved(self, statistics: Sums, radius: float = np.inf) -> OwnPolicy:
        return replace(self, policy=self.policy.improved(statistics, radius))

    def log_prior(self) -> float:
        return -self.policy.penalty()
