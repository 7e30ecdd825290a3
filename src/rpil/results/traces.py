"""The parts of the action that hold most of the evidence about a demonstration, step by step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rpil.numerics.types import Array, Float, Int

MAX_POINTS = 600
"""Points of a trace; of more steps, each point is the mean over `Traces.width` of them."""


@dataclass(frozen=True, eq=False)
class Part:
    """A part of the action of one demonstration, at P points."""

    name: str
    share: float
    """Of the evidence of all parts that point where their sum points, for or against the demonstration: 0 to 1."""
    nats: float
    """That the part adds to the sum of the log-ratios, more than in the median typical demonstration of this length;
    below 0 it speaks against the demonstration."""
    value: Float[Array, " P"]
    """What the demonstration did: the number of the action, in the units of the data; or the probability of the
    discrete action taken, by the policy of the typical."""
    low: Float[Array, " P"]
    high: Float[Array, " P"]
    """The 5 % and the 95 % quantile of what the typical do: in the same states, that is, around the mean of their
    policy there; or, of the probability of the action taken, in all their steps."""


@dataclass(frozen=True, eq=False)
class Traces:
    """Up to three parts of the action of one demonstration, those with most of the evidence first."""

    kind: Literal["continuous", "discrete"]
    parts: tuple[Part, ...]
    """One alone where actions are discrete."""
    width: int
    """Steps of a point; the last point may have fewer."""
    taken: tuple[str, ...] = ()
    """Of discrete actions: the one taken at each point, or the least likely one of its steps."""
    compared_with: Literal["typical", "trusted"] = "typical"
    """See `rpil.results.evidence.Comparison`."""

    @property
    def step(self) -> Int[Array, " P"]:
        """The first step of each point, counted from the first of the demonstration."""
        return self.width * np.arange(len(self.parts[0].value))

    def fits(self, n_steps: int) -> bool:
        """Whether these are traces of so many steps, and all parts have a value for each point."""
        if self.width < 1 or not self.parts:
            return False
        curves = [curve for part in self.parts for curve in (part.value, part.low, part.high)]
        n_points = -(-n_steps // self.width)
        return len(self.taken) in (0, n_points) and all(curve.shape == (n_points,) for curve in curves)


def point_width(n_steps: int) -> int:
    """Steps of a point of so many steps."""
    return max(1, -(-n_steps // MAX_POINTS))


def points(values: Float[Array, "n ..."], width: int) -> Float[Array, "P ..."]:
    """Means over `width` steps each, in single precision."""
    if width == 1:
        return np.asarray(values, dtype=np.float32)
    starts = np.arange(0, len(values), width)
    counts = np.diff(np.append(starts, len(values)))
    sums = np.add.reduceat(np.asarray(values, dtype=float), starts, axis=0)
    return np.asarray((sums.T / counts).T, dtype=np.float32)


def least_points(values: Float[Array, " n"], width: int) -> Int[Array, " P"]:
    """The step with the least value in each `width` steps."""
    if width == 1:
        return np.arange(len(values))
    starts = range(0, len(values), width)
    return np.array([start + int(np.argmin(values[start : start + width])) for start in starts])
