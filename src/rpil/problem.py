"""The data of one fit, and how they fall into demonstrations and blocks."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rpil.demonstrators import Company, Strangers
from rpil.passes import Array
from rpil.spaces import Space

_BLOCK_STEPS = 4096
"""Steps whose mixtures over the whole grid of reliabilities are in memory, and in cache, at a time."""


@dataclass(frozen=True, eq=False)
class Problem:
    """The data of one fit.

    Attributes
    ----------
    features : (N, D) array
        Design matrix, constant in the last column.
    actions : (N,) int array or (N, A) array
        Codes 0..K-1 of the actions taken, or what was done in each dimension.
    offsets : (M + 1,) int array
        Demonstration m owns the steps ``offsets[m]:offsets[m + 1]``.
    space : Space
        Of the actions.
    labels : (M,) int array
        1 known expert, -1 known adversary, 0 unknown.
    weight : (N,) array or None
        Weight of each step, 1 where None.
    company : Company
        Who gave which demonstration.
    """

    features: Array
    actions: Array
    offsets: Array
    space: Space
    labels: Array
    weight: Array | None = None
    company: Company = field(default_factory=Strangers)

    @classmethod
    def of_steps(cls, features: Array, actions: Array, space: Space) -> Problem:
        """Steps of which nobody needs to know the demonstration."""
        return cls(features, actions, np.array([0, len(actions)]), space, np.zeros(1, dtype=int))

    @property
    def n_demonstrations(self) -> int:
        return len(self.offsets) - 1

    @property
    def lengths(self) -> Array:
        return np.diff(self.offsets)

    @cached_property
    def segments(self) -> list[tuple[slice, slice, Array]]:
        """Blocks of steps: the steps, the demonstrations they belong to, and where each begins within the block."""
        found = []
        for start in range(0, len(self.actions), _BLOCK_STEPS):
            stop = min(start + _BLOCK_STEPS, len(self.actions))
            first = int(np.searchsorted(self.offsets, start, side="right")) - 1
            last = int(np.searchsorted(self.offsets, stop, side="left"))
            begins = np.maximum(self.offsets[first:last] - start, 0)
            found.append((slice(start, stop), slice(first, last), begins))
        return found

    def sum_steps(self, values: Array) -> Array:
        """Sums over the steps of each demonstration, (N, ...) -> (M, ...)."""
        return np.add.reduceat(values, self.offsets[:-1], axis=0)

    def spread(self, values: Array) -> Array:
        """A value of each demonstration, repeated for its steps, (M, ...) -> (N, ...)."""
        return np.repeat(values, self.lengths, axis=0)

    def select(self, demonstrations: Array, unlabelled: bool = False) -> Problem:
        """The same problem with some of the demonstrations only."""
        steps = np.concatenate([np.arange(self.offsets[m], self.offsets[m + 1]) for m in demonstrations])
        offsets = np.concatenate([[0], np.cumsum(self.lengths[demonstrations])])
        weight = None if self.weight is None else self.weight[steps]
        return replace(
            self,
            features=self.features[steps],
            actions=self.actions[steps],
            offsets=offsets,
            labels=np.zeros(len(demonstrations), dtype=int) if unlabelled else self.labels[demonstrations],
            weight=weight,
            company=self.company.select(demonstrations),
        )
