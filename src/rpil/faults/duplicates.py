"""Demonstrations that are the same, or nearly."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rpil.faults.report import Fault
from rpil.faults.rules import Measurements
from rpil.faults.settings import FaultSettings
from rpil.numerics.types import Array, Float, Int

NEIGHBOUR_ROWS = 1_024
"""Points whose distances to all others are in memory together."""


def find_duplicates(seen: Measurements) -> Iterator[Fault]:
    """Of each demonstration that is the same as an earlier one, or nearly: the earlier one."""
    exact = _exact(seen)
    for m, twin in exact.items():
        yield _finding(seen, m, twin, 0.0, 0.0, "it is the same as demonstration")
    signatures = seen.measured.signature
    if seen.columns.names and len(signatures) >= seen.settings.min_demonstrations:
        distance, nearest = nearest_others(signatures)
        limit = near_limit(distance, seen.settings)
        for m in np.flatnonzero(distance < limit).tolist():
            twin = int(nearest[m])
            if twin < m and m not in exact:
                yield _finding(seen, m, twin, float(distance[m]), limit, "it is nearly the same as demonstration")


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


def near_limit(distance: Array, settings: FaultSettings) -> float:
    """Distance from the nearest other point below which a share `near_share` of independent points lie.

    Distances of nearest neighbours in k dimensions follow a Weibull distribution, whose shape is k. With their median
    q2 and upper quartile q3,

        P(d < x) = 1 - 2^(-(x / q2)^k),        k = log 2 / log(q3 / q2).
    """
    middle, high = (float(np.quantile(distance, q, method="lower")) for q in (0.5, 0.75))
    if not 0 < middle < high:
        return 0.0
    power = np.log(high / middle) / np.log(2.0)
    return middle * float(np.clip((settings.near_share / np.log(2.0)) ** power, *settings.near_duplicate))


def _finding(seen: Measurements, m: int, twin: int, value: float, limit: float, words: str) -> Fault:
    severity = min(limit / value, 1e3) if value else 1e3
    last = int(seen.lengths[m]) - 1
    return Fault("duplicate", seen.ids[m], 0, last, "", value, limit, severity, f"{words} {seen.ids[twin]!r}")


def _exact(seen: Measurements) -> dict[int, int]:
    """Number of each demonstration with an equal earlier one, to the number of the first of these."""
    first: dict[bytes, int] = {}
    found = {}
    for m, digest in enumerate(seen.measured.digest.tolist()):
        if seen.columns.names or seen.lengths[m] >= seen.settings.min_duplicate:
            twin = first.setdefault(digest, m)
            if twin != m:
                found[m] = twin
    return found
