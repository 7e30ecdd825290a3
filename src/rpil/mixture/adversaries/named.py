"""The adversaries by name, and the one with a policy of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from rpil.data.archive import stored
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete, Space
from rpil.mixture.adversaries.box import MarginalBox, UniformBox
from rpil.mixture.adversaries.discrete import Complement, Confusion, Constant, Marginal, Uniform
from rpil.mixture.adversaries.protocol import Adversary
from rpil.numerics.types import Array, Float
from rpil.policies.linear import Actions, LinearPolicy, Outputs


@stored()
@dataclass(frozen=True, eq=False)
class OwnPolicy(Adversary):
    """psi is another policy of the kind of pi (option 2), such as softmax(phi(s)^T Psi)_k.

    Expert and adversary have the same model, so labels, the prior or the start must say which of the two is the expert.
    """

    policy: LinearPolicy
    name: str = "own policy"

    def log_prob(self, features: Float[Array, "N D"], outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        return self.policy.log_prob(self.policy.outputs(features), actions)

    def fit(self, data: FitData, outputs: Outputs, weight: Float[Array, " N"]) -> OwnPolicy:
        # Two Newton steps an iteration of EM: chosen by hand, not tuned.
        policy, _ = self.policy.fit(data, weight, max_iter=2, max_cg=20)
        return replace(self, policy=policy)

    def log_prior(self) -> float:
        return -self.policy.penalty()


ADVERSARIES: dict[str, dict[str, Callable[..., Adversary]]] = {
    "discrete": {
        "constant": lambda space, policy: Constant(),
        "uniform": lambda space, policy: Uniform(),
        "marginal": lambda space, policy: Marginal.start(space.n),
        "complement": lambda space, policy: Complement(),
        "normalised complement": lambda space, policy: Complement(normalised=True),
        "confusion": lambda space, policy: Confusion.start(space.n),
        "own policy": lambda space, policy: OwnPolicy(policy),
    },
    "continuous": {
        "uniform": lambda space, policy: UniformBox(space.log_volume),
        "marginal": lambda space, policy: MarginalBox.start(space),
        "own policy": lambda space, policy: OwnPolicy(policy),
    },
}
"""Kind of actions -> name -> the unfitted adversary, given the space of actions and an unfitted policy."""


def adversary(which: str | Adversary, space: Space, policy: LinearPolicy) -> Adversary:
    """The unfitted adversary called `which`, or `which` itself where it is an adversary; `policy` is unfitted.

    A `DataError` where none has that name for such actions, or a confusion matrix has another number of actions.
    """
    n_actions = space.n if isinstance(space, Discrete) else "continuous"
    if isinstance(which, Confusion) and n_actions != len(which.log_matrix):
        size, actions = len(which.log_matrix), f"{n_actions} actions"
        raise DataError(f"A confusion matrix of {size} x {size} was given for {actions}; give one row for each.")
    if not isinstance(which, str):
        return which
    by_name = ADVERSARIES[space.kind]
    if which not in by_name:
        raise DataError(
            f"There is no adversary called {which!r} for {space.kind} actions; choose auto, {', '.join(by_name)}."
        )
    return by_name[which](space, policy)
