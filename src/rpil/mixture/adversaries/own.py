"""An adversary with a policy of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.mixture.adversaries.protocol import Fixed
from rpil.numerics.types import Array


@stored()
@dataclass(frozen=True, eq=False)
class OwnPolicy(Fixed):
    """psi = another policy (option 2): softmax(phi(s)^T Psi)_k, or whatever the expert's is.

    Expert and adversary are alike, so labels, the prior or the start must say which of the two is the expert.
    """

    policy: Any
    name: str = "own policy"

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        return self.policy.log_prob(self.policy.outputs(features), actions)

    def fit(self, data: FitData, outputs: Array, weight: Array) -> OwnPolicy:
        policy, _ = self.policy.fit(data, weight, max_iter=2, max_cg=20)
        return replace(self, policy=policy)

    def log_prior(self) -> float:
        return -self.policy.penalty()
