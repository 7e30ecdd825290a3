"""What is measured of whole demonstrations: two in one, and actions that are the next state."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from rpil.data.demonstrations import Block
from rpil.faults.measured_columns import MeasuredColumns
from rpil.faults.settings import FaultSettings
from rpil.numerics.types import Array, Float

FARTHEST = 25.0
"""Squared distance in one column, in spreads, at most."""

NORMAL_DEVIATION = 0.6745
"""Median distance from the median of a normal distribution of standard deviation 1."""

LEAST_SPREAD = 0.02
"""Standard deviations of a column by which first, and last, steps do not differ."""

UNUSUAL_LENGTHS = 0.02
"""Share of the demonstrations that are unusually short, and long."""

LENGTH_MARGIN = 0.1
"""By how much a joined demonstration may be unusually short or long."""

LARGE_CHANGE = 0.99
"""Quantile of the changes from step to step, in which a leap is measured."""

GAP_SHARE, LEAST_GAP = 0.1, 1.0
"""The limit lies so far from joined demonstrations towards clean ones; with a smaller gap between the two nothing is
known."""


@dataclass(frozen=True, eq=False)
class Ends:
    """How demonstrations begin and end, (2, C) for first and last steps, and how long they are.

    `limit`: threshold below which the best split point counts as a joint of two episodes; NaN if clean and joined ones
    overlap.
    """

    centre: Float[Array, "2 C"]
    spread: Float[Array, "2 C"]
    lengths: tuple[float, float]
    leap: float
    limit: float = np.nan

    def boundary(self, values: Float[Array, "C T"]) -> tuple[float, int]:
        """Score of the most boundary-like step (smaller is more alike), and that step."""
        n = values.shape[1]
        low, high = self.lengths
        first, end = int(max(low, n - high)), int(min(high, n - low))
        if first < 1 or first >= end:
            return np.inf, 0
        rows = [values[:, first:end], values[:, first - 1 : end - 1]]  # a beginning, after an end
        far = [
            np.minimum(((x - c[:, None]) / s[:, None]) ** 2, FARTHEST).mean(axis=0)
            for x, c, s in zip(rows, self.centre, self.spread, strict=True)
        ]
        leaps = np.log1p(
            np.sqrt(((rows[0] - rows[1]) ** 2 / self.spread.max(axis=0)[:, None] ** 2).mean(axis=0)) / self.leap
        )
        unlike = far[0] + far[1] - 2.0 * leaps
        at = int(np.argmin(unlike))
        return float(unlike[at]), first + at


def learn_ends(sample: Block, columns: MeasuredColumns, s: FaultSettings) -> Ends | None:
    """Of a sample; the limit lies between its demonstrations and pairs of them, joined."""
    if len(sample.offsets) <= s.min_demonstrations or columns.is_action.all():
        return None
    values, offsets = columns.of(sample)[~columns.is_action], sample.offsets
    least = LEAST_SPREAD * columns.spread[~columns.is_action][:, None]
    ends = [values[:, offsets[:-1]], values[:, offsets[1:] - 1]]
    centre = [np.median(x, axis=1, keepdims=True) for x in ends]
    spread = [
        np.median(np.abs(x - c), axis=1, keepdims=True) / NORMAL_DEVIATION + least
        for x, c in zip(ends, centre, strict=True)
    ]
    wide = np.maximum(*spread)
    change = np.sqrt(((np.diff(values, axis=1) / wide) ** 2).mean(axis=0))
    short, long = np.quantile(np.diff(offsets), [UNUSUAL_LENGTHS, 1 - UNUSUAL_LENGTHS])
    bounds = (1 - LENGTH_MARGIN) * short, (1 + LENGTH_MARGIN) * long
    leap = float(np.quantile(change, LARGE_CHANGE)) + 1e-12
    fitted = Ends(np.stack(centre)[:, :, 0], np.stack(spread)[:, :, 0], bounds, leap)
    each = [values[:, a:b] for a, b in itertools.pairwise(offsets)][: s.map_sample]
    clean = np.minimum([fitted.boundary(x)[0] for x in each], 1e3)
    joined = [fitted.boundary(np.concatenate([x, y], axis=1))[0] for x, y in itertools.pairwise(each)]
    low, high = np.quantile(clean, 0.25), np.quantile(joined, 0.75)
    limit = high + GAP_SHARE * (min(low, high + FARTHEST) - high)
    return replace(fitted, limit=float(limit) if low > high + LEAST_GAP else np.nan)


def next_state(block: Block, n_steps: int = 16) -> Float[Array, "M A 2"]:
    """Whether each action moves, and is then a state at the next step, at some steps of each demonstration."""
    n_actions = block.actions.shape[1] if block.actions.ndim == 2 else 0
    out = np.zeros((len(block.offsets) - 1, n_actions, 2))
    for m, (first, end) in enumerate(itertools.pairwise(block.offsets)):
        if n_actions and end - first > 2:
            at = np.unique(np.linspace(first, end - 2, n_steps).astype(int))
            actions, after = block.actions[at], block.observations[at + 1]
            wide = np.ptp(actions, axis=0)
            near = np.abs(actions[:, :, None] - after[:, None, :]) <= 1e-6 * wide[:, None]
            out[m] = np.column_stack([wide > 0, (wide > 0) & near.all(axis=0).any(axis=1)])
    return out
