"""Hold the two types that every world and every column share: demonstrations of a draw, and a world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from rpil import Demonstrations


@dataclass(frozen=True, eq=False)
class Made:
    """M demonstrations of N steps: one draw of one cell. The truth serves to score, never to learn."""

    demonstrations: Demonstrations
    good: np.ndarray
    """(M,) bool."""
    success: np.ndarray | None = None
    """(M,) 0 or 1 as recorded, where the recorder notes it."""
    good_steps: np.ndarray | None = None
    """(N,) bool, where the truth is known step by step."""


@runtime_checkable
class World(Protocol):
    """Demonstrations whose quality is known, and a learner that is driven."""

    name: str
    source: str
    licence: str
    published: str
    """Figures of others, in one line."""
    cells: tuple[str, ...]
    needs: tuple[str, ...]
    """Modules without which it cannot run."""
    whole: float
    """What counts as 100 points: 100 of a success in percent, and the return of a good policy of others."""

    def make(self, cell: str, seed: int, quick: bool) -> Made:
        """Draw the demonstrations of a cell; a seed gives the same bits each time."""
        ...

    def drive(self, cell: str, made: Made, weights: np.ndarray, seed: int, quick: bool) -> float:
        """Train the world's learner with a weight (N,) for each step, and return its success in percent or its return.

        NaN says that this world drives no policy.
        """
        ...
