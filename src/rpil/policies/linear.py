"""The linear policy of a space of actions."""

from __future__ import annotations

from rpil.data.spaces import Discrete, Space
from rpil.numerics.types import Array, Float, Num
from rpil.policies.softmax import SoftmaxPolicy
from rpil.policies.student import StudentPolicy

LinearPolicy = SoftmaxPolicy | StudentPolicy

Outputs = Float[Array, "N O"]
"""The distribution of the actions in each of N states: log-probabilities of all K actions, or means of A numbers."""

Actions = Num[Array, "N ..."]
"""The actions taken: codes (N,), or numbers (N, A)."""


def linear_policy(space: Space, ridge: Float[Array, " D"], n_steps: float) -> LinearPolicy:
    """The policy before it is fitted; `n_steps` is the total weight of the steps that it will be fitted to."""
    if isinstance(space, Discrete):
        return SoftmaxPolicy.zero(space.n, ridge)
    return StudentPolicy.zero(space, ridge, n_steps)
