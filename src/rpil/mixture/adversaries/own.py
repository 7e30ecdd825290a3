"""An adversary with a policy of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.mixture.adversaries.protocol import Adversary
from rpil.numerics.types import Array, Float
from rpil.policies.protocol import Actions, Outputs, Policy


@stored()
@dataclass(frozen=True, eq=False)
class OwnPolicy(Adversary):
    """psi is another policy of the kind of pi (option 2), such as softmax(phi(s)^T Psi)_k.

    Expert and adversary have the same model, so labels, the prior or the start must say which of the two is the expert.
    """

    policy: Policy
    name: str = "own policy"

    def log_prob(self, features: Float[Array, "N D"], outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        return self.policy.log_prob(self.policy.outputs(features), actions)

    def fit(self, data: FitData, outputs: Outputs, weight: Float[Array, " N"]) -> OwnPolicy:
        # Two Newton steps an iteration of EM: chosen by hand, not tuned.
        policy, _ = self.policy.fit(data, weight, max_iter=2, max_cg=20)
        return replace(self, policy=policy)

    def log_prior(self) -> float:
        return -self.policy.penalty()
