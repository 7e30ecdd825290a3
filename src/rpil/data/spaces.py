"""Spaces of actions: one of n numbered actions, or any point of a box of A numbers; and the codes of actions.

A space tells the model how many numbers an action has and what may be done.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rpil.data.archive import NOT_STORED, stored
from rpil.data.arrays import check_squares
from rpil.data.demonstrations import DemonstrationSet
from rpil.data.errors import DataError
from rpil.numerics.types import Array


@stored()
@dataclass(frozen=True)
class Discrete:
    """The actions `start` .. `start` + `n` - 1. Models use their codes, 0 .. n - 1."""

    n: int
    start: int = field(default=0, metadata=NOT_STORED)
    kind: Literal["discrete"] = "discrete"

    has_density = False  # whether a policy gives a density of numbers
    n_parts = 1  # numbers in one action

    def bounded(self, outputs: Array) -> Array:
        """The `outputs` of a policy as they are: log-probabilities need no bounds."""
        return outputs

    def act(self, outputs: Array) -> Array:
        """Codes (N,) of the most likely actions under log-probabilities (N, n)."""
        return np.asarray(outputs.argmax(axis=1))


@stored(low="A", high="A")
@dataclass(frozen=True, eq=False)
class Box:
    """Actions of A numbers, each between its bounds (A,): float32 in environments, else float64."""

    low: Array
    high: Array
    kind: Literal["continuous"] = "continuous"
    has_density = True

    @classmethod
    def around(cls, actions: Array) -> Box:
        """The smallest box that holds `actions` (N, A); a constant part of the actions gets a width of 1."""
        low, high = actions.min(axis=0), actions.max(axis=0)
        constant = high <= low
        return cls(np.where(constant, low - 0.5, low), np.where(constant, high + 0.5, high))

    @property
    def n_parts(self) -> int:
        """Numbers in one action: A."""
        return len(self.low)

    @property
    def log_volume(self) -> float:
        """Log of the volume: minus the log-density of the uniform distribution in the box."""
        return float(np.log(self.high - self.low).sum())

    def bounded(self, outputs: Array) -> Array:
        """The closest points (N, A) of the box, in its precision."""
        # Clipped before the cast: what is far beyond the box may be beyond its precision too.
        return np.clip(outputs, self.low, self.high).astype(self.low.dtype, copy=False)

    act = bounded


Space = Discrete | Box


def action_space(data: DemonstrationSet) -> tuple[Space, Array]:
    """The space of the actions, and the K classes where they are discrete, else none.

    That of continuous actions is the smallest box that holds them. A `DataError` where all actions are the same, or too
    large or too alike to be squared.
    """
    source = data.source
    if data.is_discrete:
        if len(data.classes) < 2:
            only = repr(data.classes[0].item())
            raise DataError(f"{source}: every action is {only}, one class only; give demonstrations with two at least.")
        return Discrete(len(data.classes)), data.classes
    ends = np.stack([data.low, data.high]).astype(float)
    if (ends[0] == ends[1]).all():
        raise DataError(f"{source}: every action is the same; give demonstrations with two at least.")
    check_squares(ends, f"{source}: action")
    return Box.around(ends), np.empty(0)


def encode_actions(classes: Array, actions: Array, source: str) -> Array:
    """Codes (N,) of discrete actions among `classes` (K,), or a `DataError` that names another; continuous actions (N,
    A) as floats if there are no classes."""
    if not len(classes):
        return np.asarray(actions, dtype=float)
    if classes.dtype.kind in "iu" and actions.dtype.kind in "iu" and np.array_equal(classes, np.arange(len(classes))):
        codes = actions.clip(0, len(classes) - 1)  # they are codes already
    else:
        codes = np.searchsorted(classes, actions).clip(max=len(classes) - 1)
    unknown = np.flatnonzero(classes[codes] != actions)
    if len(unknown):
        action, names = actions[unknown[0]].item(), ", ".join(map(str, classes))
        raise DataError(
            f"{source}: action {action!r} is not among the fitted ones ({names}); fit again with it, or leave it out."
        )
    return codes
