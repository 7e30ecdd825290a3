"""Segments of demonstrations: consecutive rows of one kind, with a score and a reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

KINDS = ("act", "idle", "takeover", "back", "repeated")


@dataclass(frozen=True)
class Segments:
    """Segments of demonstrations, sorted by demonstration and start; rows are half-open and tile each demonstration."""

    demonstration: np.ndarray  # (N,) int, its number among the ids
    start: np.ndarray  # (N,) int, first row within the demonstration
    end: np.ndarray  # (N,) int, row after the last
    kind: np.ndarray  # (N,) int8, index into KINDS
    score: np.ndarray  # (N,) float, lower is worse; NaN where nothing is known
    reason: list[str]  # (N,) "" or a short reason


def joined(parts: Sequence[Segments]) -> Segments:
    """The segments of several tasks, sorted."""
    of = {one.name: np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(Segments)[:-1]}
    order = np.lexsort((of["start"], of["demonstration"]))
    reasons = [reason for part in parts for reason in part.reason]
    return Segments(**{name: of_each[order] for name, of_each in of.items()}, reason=[reasons[k] for k in order])
