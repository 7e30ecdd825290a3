"""The linear policy of a space of actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rpil.data.spaces import Space
from rpil.numerics.types import Array
from rpil.policies.protocol import Policy
from rpil.policies.softmax import SoftmaxPolicy
from rpil.policies.student import StudentPolicy

_LINEAR: dict[str, Callable[[Any, Array, float], Policy]] = {
    "discrete": lambda space, ridge, n_steps: SoftmaxPolicy.zero(space.n, ridge),
    "continuous": StudentPolicy.zero,
}


def linear_policy(space: Space, ridge: Array, n_steps: float) -> Policy:
    """The policy for such actions before it has seen data; `n_steps` is the weight of what it will see."""
    return _LINEAR[space.kind](space, ridge, n_steps)
