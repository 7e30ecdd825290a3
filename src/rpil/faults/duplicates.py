"""Demonstrations that are the same, or nearly."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rpil.data.copies import Copies, digests
from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock
from rpil.faults.rule import Fault, Learned, Measurements, Rule
from rpil.numerics.types import Array, Float, Int

NEIGHBOUR_ROWS = 1_024
"""Points whose distances to all others are in memory together."""

PARTS, DIRECTIONS, LENGTH_WEIGHT = 8, 8, 10.0
"""Of a signature: parts of a demonstration, random directions of its columns, and standard deviations of a column to
which a length e times longer amounts."""


class Duplicate(Rule):
    """Of each demonstration that is the same as an earlier one, or nearly: the earlier one."""

    name, words = "duplicate", "another demonstration is the same, or nearly"
    causes = ("never moves",)

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """A hash; and means over parts of each demonstration, seen from some directions, and the logarithm of its
        length."""
        offsets, lengths, spread = block.offsets, np.diff(block.offsets), block.columns.spread
        directions = np.random.default_rng(0).normal(size=(DIRECTIONS, len(spread)))
        directions /= spread
        firsts = offsets[:-1, None] + (np.arange(PARTS) * lengths[:, None]) // PARTS
        widths = np.diff(firsts, append=offsets[1:, None]).ravel()
        means = np.add.reduceat(directions @ block.values, firsts.ravel(), axis=1) / np.maximum(widths, 1)
        parts = np.ascontiguousarray(means.T).reshape(len(lengths), -1)
        signatures = np.column_stack([parts, LENGTH_WEIGHT * np.log(lengths)])
        return digests(block.block.observations, block.block.actions, offsets), signatures

    @classmethod
    def follows(cls, fault: Fault, cause: Fault) -> bool:
        """What does not move is alike, but not the same."""
        return fault.value > 0

    @classmethod
    def find(cls, data: Measurements) -> Iterator[Fault]:
        digest, signatures = data.measured[cls.measure]
        are_measured = bool(data.learned.columns.names)
        first = Copies.of(digest).copy_of
        is_copy = (first < np.arange(len(first))) & (are_measured | (data.lengths >= settings.MIN_DUPLICATE))
        twins = [(m, int(first[m]), 0.0, 0.0, 1e3, "") for m in np.flatnonzero(is_copy).tolist()]
        if are_measured and len(signatures) >= settings.FEWEST_DEMONSTRATIONS:
            distance, nearest = nearest_others(signatures)
            limit = near_limit(distance)
            for m in np.flatnonzero((distance < limit) & (nearest < np.arange(len(nearest))) & ~is_copy).tolist():
                value = float(distance[m])
                twins.append((m, int(nearest[m]), value, limit, min(limit / value, 1e3) if value else 1e3, "nearly "))
        for m, twin, value, limit, severity, how in twins:
            sentence, last = f"it is {how}the same as demonstration {data.ids[twin]!r}", int(data.lengths[m]) - 1
            yield Fault(cls.name, data.ids[m], 0, last, "", value, limit, severity, sentence)


def nearest_others(points: Float[Array, "M S"]) -> tuple[Float[Array, " M"], Int[Array, " M"]]:
    """The distance of each point to the nearest other one, and the number of that."""
    squares = np.einsum("ms,ms->m", points, points)
    nearest = np.empty(len(points), dtype=int)
    for begin in range(0, len(points), NEIGHBOUR_ROWS):
        rows = np.arange(begin, min(begin + NEIGHBOUR_ROWS, len(points)))
        further = squares - 2 * points[rows] @ points.T  # the squared distance less that of the point itself
        further[rows - begin, rows] = np.inf
        nearest[rows] = further.argmin(axis=1)
    return np.linalg.norm(points - points[nearest], axis=1), nearest


def near_limit(distance: Array) -> float:
    """Distance from the nearest other point below which a share `NEAR_SHARE` of independent points lie.

    Distances of nearest neighbours in k dimensions follow a Weibull distribution, whose shape is k. With their median
    q2 and upper quartile q3,

        P(d < x) = 1 - 2^(-(x / q2)^k),        k = log 2 / log(q3 / q2).
    """
    middle, high = (float(np.quantile(distance, q, method="lower")) for q in (0.5, 0.75))
    if not 0 < middle < high:
        return 0.0
    power = np.log(high / middle) / np.log(2.0)
    return middle * float(np.clip((settings.NEAR_SHARE / np.log(2.0)) ** power, *settings.NEAR_DUPLICATE))
