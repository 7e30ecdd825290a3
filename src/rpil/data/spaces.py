"""What actions there are: one of K, or a point of a box."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from rpil.data.archive import stored
from rpil.numerics.types import Array


@runtime_checkable
class Space(Protocol):
    """What the parts of a model need to know of the actions."""

    @property
    def kind(self) -> Literal["discrete", "continuous"]:
        """Which policies and adversaries there are for it."""

    @property
    def n_parts(self) -> int:
        """Numbers in one action: A."""

    def bounded(self, outputs: Array) -> Array:
        """Outputs of a policy as far as they can be acted upon."""

    def act(self, outputs: Array) -> Array:
        """What to do where a policy has these `outputs` (N, ...): codes (N,), or numbers (N, A)."""


@stored()
@dataclass(frozen=True)
class Discrete:
    """K actions, with the codes 0 .. K - 1."""

    n: int
    kind: Literal["discrete"] = "discrete"

    @property
    def n_parts(self) -> int:
        return 1

    def bounded(self, outputs: Array) -> Array:
        """Log-probabilities know their bounds."""
        return outputs

    def act(self, outputs: Array) -> Array:
        """The most likely action."""
        best: Array = outputs.argmax(axis=1)
        return best


@stored(low="A", high="A")
@dataclass(frozen=True, eq=False)
class Box:
    """Actions with A numbers, each within its bounds.

    Attributes
    ----------
    low, high : (A,) arrays
    """

    low: Array
    high: Array
    kind: Literal["continuous"] = "continuous"

    @property
    def n_parts(self) -> int:
        return len(self.low)

    @classmethod
    def around(cls, actions: Array) -> Box:
        """The smallest box that holds `actions` (N, A); a dimension in which nothing moves gets a width of 1."""
        low, high = actions.min(axis=0), actions.max(axis=0)
        still = high <= low
        return cls(np.where(still, low - 0.5, low), np.where(still, high + 0.5, high))

    def bounded(self, outputs: Array) -> Array:
        """The closest that the box holds."""
        return np.clip(outputs, self.low, self.high)

    act = bounded

    @property
    def log_volume(self) -> float:
        """Of the box: minus the log-density of an action that may be anything."""
        return float(np.log(self.high - self.low).sum())
