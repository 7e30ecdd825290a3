"""What an adversary does in a state: psi(a|s), one small frozen class each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete, Space
from rpil.mixture.adversaries.box import MarginalBox, UniformBox
from rpil.mixture.adversaries.discrete import Complement, Confusion, Constant, Marginal, Uniform
from rpil.mixture.adversaries.own import OwnPolicy
from rpil.mixture.adversaries.protocol import Adversary
from rpil.policies.protocol import Policy

ADVERSARIES: dict[str, dict[str, Callable[[Any, Policy], Adversary]]] = {
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
"""Kind of actions -> name -> start of the adversary, given the space of actions and a policy that has seen no data."""


def adversary(which: str | Adversary, space: Space, policy: Policy) -> Adversary:
    """The adversary called `which` before it has seen data, or `which` itself where it is one already.

    Raises
    ------
    DataError
        If there is none of that name for such actions, or a confusion matrix has another number of actions.
    """
    if isinstance(which, Confusion) and space != Discrete(len(which.log_matrix)):
        size, actions = len(which.log_matrix), f"{getattr(space, 'n', 'continuous')} actions"
        raise DataError(f"A confusion matrix of {size} x {size} was given for {actions}; give one row for each.")
    if not isinstance(which, str):
        return which
    known = ADVERSARIES[space.kind]
    if which not in known:
        raise DataError(
            f"There is no adversary called {which!r} for {space.kind} actions; choose auto, {', '.join(known)}."
        )
    return known[which](space, policy)


def marginal(data: FitData, policy: Policy) -> Adversary:
    """The marginal of the actions of all demonstrations."""
    start = adversary("marginal", data.space, policy)
    return start.fit(data, data.features, np.ones(len(data.actions)))  # it asks for no outputs
