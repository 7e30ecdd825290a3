"""Demonstrations with a truth that scores and that no method reads: recorded, simulated, and of a point mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.data.demonstrations import Demonstrations

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class World:
    """M demonstrations, and the truth about them."""

    demonstrations: Demonstrations
    is_good: Array
    """(M,) int: 1 good, 0 bad, -1 in between."""
    quality: Array
    """(M,) float: higher is better."""
    people: tuple[str, ...] = ()
    """The demonstrator of each demonstration, where known."""

    @classmethod
    def of(cls, demonstrations: Demonstrations, is_good: Any) -> World:
        """A world in which nothing is known but who is good."""
        good = np.asarray(is_good, dtype=int)
        return cls(demonstrations, good, good.astype(float))

    def select(self, kept: Array) -> World:
        """The demonstrations with these indices."""
        people = tuple(self.people[m] for m in kept) if self.people else ()
        return World(self.demonstrations.select(kept), self.is_good[kept], self.quality[kept], people)

    def good_half(self) -> World:
        """The good demonstrations alone."""
        return self.select(np.flatnonzero(self.is_good == 1))
