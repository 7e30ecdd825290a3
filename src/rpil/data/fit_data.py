"""The data of one fit, and where each demonstration begins and ends."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from rpil.data.demonstrator_groups import Demonstrators
from rpil.data.spaces import Space
from rpil.numerics.types import Array


@dataclass(frozen=True, eq=False)
class FitData:
    """The data of one fit."""

    features: Array  # (N, D): design matrix, constant in the last column
    actions: Array  # (N,): codes 0..K-1 of discrete actions; or (N, A): numbers
    offsets: Array  # (M + 1,): demonstration m owns the steps ``offsets[m]:offsets[m + 1]``
    space: Space  # of the actions
    labels: Array = field(default_factory=lambda: np.array([], dtype=int))
    """(M,): 1 expert, -1 adversary, 0 not labelled, the default; read by the mixture alone: the judge has answers."""
    demonstrators: Demonstrators = field(default_factory=Demonstrators)
    judged: Array | None = None  # bool: the parts of continuous actions that the judge sees; None for all
    action_names: tuple[str, ...] = ()  # of the parts of continuous actions, or of discrete actions; may be empty

    def __post_init__(self) -> None:
        if not len(self.labels):
            object.__setattr__(self, "labels", np.zeros(self.n_demonstrations, dtype=int))

    @classmethod
    def from_steps(cls, features: Array, actions: Array, space: Space) -> FitData:
        """Steps without demonstrations, as one unlabelled demonstration."""
        return cls(features, actions, np.array([0, len(actions)]), space)

    def __sizeof__(self) -> int:
        """Bytes, which Dask asks for."""
        return self.features.nbytes + self.actions.nbytes

    @property
    def n_demonstrations(self) -> int:
        """M."""
        return len(self.offsets) - 1

    def action_name(self, k: int) -> str:
        """The name of part k of continuous actions, or of discrete action k; its number where it has none."""
        return self.action_names[k] if self.action_names else str(k)

    @property
    def lengths(self) -> Array:
        """Steps per demonstration, (M,)."""
        return np.diff(self.offsets)

    def sum_steps(self, values: Array) -> Array:
        """Sums over the steps of each demonstration, (N, ...) -> (M, ...)."""
        return np.add.reduceat(values, self.offsets[:-1], axis=0)

    def mean_steps(self, values: Array) -> Array:
        """Means over the steps of each demonstration, (N,) -> (M,)."""
        means: Array = self.sum_steps(values) / self.lengths
        return means

    def per_step(self, values: Array) -> Array:
        """The value of each demonstration repeated for each of its steps, (M, ...) -> (N, ...)."""
        return np.repeat(values, self.lengths, axis=0)

    def select(self, demonstrations: Array) -> FitData:
        """The data of the demonstrations with these numbers, without demonstrators."""
        steps = np.concatenate([np.arange(self.offsets[m], self.offsets[m + 1]) for m in demonstrations])
        offsets = np.concatenate([[0], np.cumsum(self.lengths[demonstrations])])
        return replace(
            self,
            features=self.features[steps],
            actions=self.actions[steps],
            offsets=offsets,
            labels=self.labels[demonstrations],
            demonstrators=Demonstrators(),
        )
