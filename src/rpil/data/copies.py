"""Digests: demonstrations whose observations and actions are the same, bit for bit, and the identity of a run.

A copy is no second witness. So the judge reads one of each set of copies, and what it says of that one holds for all.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.data.text import counted
from rpil.numerics.types import Array, Int, Num, Shaped

MAX_NEW = 0.8
"""Different observations for each step of different demonstrations, up to which equal ones may be independent."""


@dataclass(frozen=True, eq=False)
class Copies:
    """Which of M demonstrations are copies of one another."""

    first: Int[Array, " K"]
    """The first of each of K different demonstrations, in order."""
    place: Int[Array, " M"]
    """Which of these each of the M demonstrations is, 0 .. K - 1."""

    @classmethod
    def of(cls, contents: Shaped[Array, " M"]) -> Copies:
        """The copies among demonstrations with these `contents`, such as `digests` of them."""
        _, first, group = np.unique(contents, return_index=True, return_inverse=True)
        return cls(*np.unique(first[group], return_inverse=True))

    @property
    def any(self) -> bool:
        """Whether there are copies."""
        return len(self.first) < len(self.place)

    @property
    def all_same(self) -> bool:
        """Whether all are copies of one, and nothing can be compared."""
        return self.any and len(self.first) == 1

    @property
    def judged(self) -> Int[Array, " K"]:
        """The demonstrations that are judged: the different ones, or all where all are copies of one."""
        return np.arange(len(self.place)) if self.all_same else self.first

    @property
    def copy_of(self) -> Int[Array, " M"]:
        """The first of the copies of each demonstration, which may be itself."""
        return self.first[self.place]

    def rows(self, offsets: Int[Array, " M1"]) -> Int[Array, " N"]:
        """For each step of all demonstrations, whose bounds are `offsets`, its row among those of the first ones."""
        lengths = np.diff(offsets)
        begins = np.cumsum(np.append(0, lengths[self.judged]))[:-1]
        return np.asarray(np.arange(offsets[-1]) + np.repeat(begins[self.place] - offsets[:-1], lengths))

    @property
    def sentence(self) -> str:
        """How many copies there are; empty where there are none."""
        if not self.any:
            return ""
        if self.all_same:
            return f"All {len(self.place):,} demonstrations are copies of one: there is nothing to compare."
        n_copies, n_copied = len(self.place) - len(self.first), int((np.bincount(self.place) > 1).sum())
        copies = f"{n_copies:,} demonstrations are copies" if n_copies > 1 else "One demonstration is a copy"
        return f"{copies} of {counted(n_copied, 'other')}: each is judged once."


def copies_among(demonstrations: Demonstrations) -> Copies:
    """The copies among demonstrations in memory. Where actions are discrete and the same observations come again and
    again, as on a grid, there are none: independent demonstrations may be equal there, and agree."""
    found = Copies.of(digests(demonstrations.observations, demonstrations.actions, demonstrations.offsets))
    if found.any and demonstrations.is_discrete:
        different = np.ascontiguousarray(demonstrations.select(found.first).observations)
        if len({row.tobytes() for row in different}) <= MAX_NEW * len(different):
            return Copies.of(np.arange(len(demonstrations)))
    return found


def digests(
    observations: Num[Array, "N D"], actions: Shaped[Array, "N ..."], offsets: Int[Array, " M1"]
) -> Shaped[Array, " M"]:
    """A hash of all the values of each demonstration, which has the steps ``offsets[m]:offsets[m + 1]``."""
    found = []
    for start, end in pairwise(offsets.tolist()):
        own = hashlib.sha256(observations[start:end].tobytes())  # which processors have instructions for
        own.update(actions[start:end].tobytes())
        found.append(own.digest())
    return np.array(found, dtype="S32")


RUN_KEY = "rpil.run"
"""Key of the run id among the metadata of a Parquet file."""


def run_id(ids: Sequence[object], offsets: Array, log_odds: Array) -> str:
    """Twelve hexadecimal digits, a digest of the ids, lengths and log-odds of the M demonstrations.

    It depends on the answer and not on the time, so that the same data, options and seed give the same files.
    """
    digest = hashlib.sha256("\0".join(map(str, ids)).encode("utf-8", "surrogatepass"))
    for values in (np.asarray(offsets, np.int64), np.asarray(log_odds, np.float64)):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:12]
