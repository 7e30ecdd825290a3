"""Copies: demonstrations whose observations and actions are the same, bit for bit.

A copy is no second witness. So the judge reads one of each set of copies, and what it says of that one holds for all.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rpil.data.arrays import are_whole
from rpil.data.demonstrations import Demonstrations
from rpil.numerics.types import Array, Int, Num, Shaped


@dataclass(frozen=True, eq=False)
class Copies:
    """Which of M demonstrations are copies of one another."""

    first: Int[Array, " K"]
    """The first of each of K different demonstrations, in order."""
    place: Int[Array, " M"]
    """Which of these each of the M demonstrations is, 0 .. K - 1."""

    @classmethod
    def of(cls, contents: Shaped[Array, " M"]) -> Copies:
        """The copies among demonstrations with these `digests`; none where all are the same, because nothing would be
        left to compare."""
        _, first, group = np.unique(contents, return_index=True, return_inverse=True)
        if len(first) == 1:
            first = group = np.arange(len(contents))
        order = np.argsort(first)
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        return cls(first[order], place[group])

    @property
    def any(self) -> bool:
        """Whether there are copies."""
        return len(self.first) < len(self.place)

    def rows(self, offsets: Int[Array, " M1"]) -> Int[Array, " N"]:
        """Of each step of all demonstrations, whose bounds are `offsets`, its row among those of the first ones."""
        lengths = np.diff(offsets)
        begins = np.cumsum(np.append(0, lengths[self.first]))[:-1]
        return np.asarray(np.arange(offsets[-1]) + np.repeat(begins[self.place] - offsets[:-1], lengths))

    @property
    def sentence(self) -> str:
        """How many copies there are; empty where there are none."""
        if not self.any:
            return ""
        n_copies, n_copied = len(self.place) - len(self.first), int((np.bincount(self.place) > 1).sum())
        copies = f"{n_copies:,} demonstrations are copies" if n_copies > 1 else "One demonstration is a copy"
        return f"{copies} of {n_copied:,} other{'s' * (n_copied > 1)}: each is judged once."


def copies_among(demonstrations: Demonstrations) -> Copies:
    """The copies among demonstrations in memory. Where all is counted and nothing measured, as on a board or a grid,
    there are none: independent demonstrations may be equal there, and agree."""
    observations, offsets = demonstrations.observations, demonstrations.offsets
    if demonstrations.is_discrete and are_whole(observations):
        return Copies.of(np.arange(len(demonstrations)))
    return Copies.of(digests(observations, demonstrations.actions, offsets))


def digests(
    observations: Num[Array, "N D"], actions: Shaped[Array, "N ..."], offsets: Int[Array, " M1"]
) -> Shaped[Array, " M"]:
    """A hash of all the values of each demonstration, which has the steps ``offsets[m]:offsets[m + 1]``."""
    found = []
    for start, end in pairwise(offsets):
        own = hashlib.blake2b(np.ascontiguousarray(observations[start:end]).tobytes(), digest_size=16)
        own.update(np.ascontiguousarray(actions[start:end]).tobytes())
        found.append(own.digest())
    return np.array(found, dtype="S16")
