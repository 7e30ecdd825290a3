"""The parts of the action that hold most of the evidence about a demonstration, step by step."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rpil.data.archive import array_field, stored
from rpil.numerics.types import Array, Float, Int

MAX_DRAWN = 300
"""Demonstrations with traces, and with drawings on a page: those that are most worth a look."""

MAX_POINTS = 400
"""Points of a curve over the steps of a demonstration; of more steps, each point is the mean over some of them."""


CURVE = array_field("P", np.float32, np.float64, missing=True)


@stored()
@dataclass(frozen=True, eq=False)
class TracedPart:
    """A part of the action of one demonstration, at P points."""

    name: str
    share: float
    """Of the evidence of all parts that point where their sum points, for or against the demonstration: 0 to 1."""
    nats: float
    """That the part adds to the sum of the log-ratios, more than in the median typical demonstration of this length;
    below 0 it speaks against the demonstration."""
    value: Float[Array, " P"] = field(metadata=CURVE)
    """What the demonstration did: the number of the action, in the units of the data; or the probability of the
    discrete action taken, by the policy of the typical."""
    low: Float[Array, " P"] = field(metadata=CURVE)
    high: Float[Array, " P"] = field(metadata=CURVE)
    """The 5 % and the 95 % quantile of what the typical do: in the same states, that is, around the mean of their
    policy there; or, of the probability of the action taken, in all their steps."""


@stored(renews=("P",))
@dataclass(frozen=True, eq=False)
class Traces:
    """Up to three parts of the action of one demonstration, those with most of the evidence first."""

    parts: tuple[TracedPart, ...]
    """One alone where actions are discrete."""
    taken: tuple[str, ...] = ()
    """Of discrete actions: the one taken at each point, or the least likely one of its steps."""
    compared_with: Literal["typical", "trusted"] = "typical"
    """See `rpil.results.evidence.StepEvidence`."""

    def fits(self, n_steps: int) -> bool:
        """Whether these are traces of so many steps, and all parts have a value for each point."""
        curves = [curve for part in self.parts for curve in (part.value, part.low, part.high)]
        n_points = len(bin_starts(n_steps))
        is_complete = all(curve.shape == (n_points,) for curve in curves)
        return bool(curves) and is_complete and len(self.taken) in (0, n_points)


def bin_starts(n_steps: int) -> Int[Array, " P"]:
    """The first step of each of at most `MAX_POINTS` points, which hold nearly equally many steps."""
    n_points = min(n_steps, MAX_POINTS)
    return np.asarray(np.arange(n_points) * n_steps // n_points)


def bin_means(values: Float[Array, " n"]) -> Float[Array, " P"]:
    """The means over the steps of each point."""
    starts = bin_starts(len(values))
    return np.asarray(np.add.reduceat(values, starts, dtype=float) / np.diff(np.append(starts, len(values))))
