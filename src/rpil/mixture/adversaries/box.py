"""Adversaries with continuous actions: densities psi(a|s) over a box."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.mixture.adversaries.protocol import Adversary
from rpil.numerics.types import Array, Float, Int
from rpil.policies.linear import Actions, Outputs

N_BINS = 20
"""Bins of the histogram of each part of an action. Chosen by hand, not tuned."""


@stored()
@dataclass(frozen=True)
class UniformBox(Adversary):
    """psi = 1 / volume: uniform over the box."""

    log_volume: float
    name: str = "uniform"

    def log_prob(self, features: Float[Array, "N D"], outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        return np.full(len(actions), -self.log_volume)


@stored(low="A", width="A", log_density="A B")
@dataclass(frozen=True, eq=False)
class MarginalBox(Adversary):
    """psi = prod_j h_j(a_j), a histogram of each part of the action, whatever the state.

    Every bin has a Dirichlet prior worth one step, so that no action is impossible.
    """

    low: Float[Array, " A"]
    width: Float[Array, " A"]
    """Where the bins of each part begin, and the width of a bin."""
    log_density: Float[Array, "A B"]
    name: str = "marginal"

    @classmethod
    def start(cls, box: Box) -> MarginalBox:
        """The uniform density, with `N_BINS` bins a part."""
        span = box.high - box.low
        return cls(box.low, span / N_BINS, np.tile(-np.log(span)[:, None], (1, N_BINS)))

    def log_prob(self, features: Float[Array, "N D"], outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        return np.asarray(np.take_along_axis(self.log_density, self._bins(actions).T, axis=1).sum(axis=0))

    def fit(self, data: FitData, outputs: Outputs, weight: Float[Array, " N"]) -> MarginalBox:
        n_bins = self.log_density.shape[1]
        columns = self._bins(data.actions).T
        counts = 1.0 + np.stack([np.bincount(column, weight, minlength=n_bins) for column in columns])
        share = counts / counts.sum(axis=1, keepdims=True)
        return replace(self, log_density=np.log(share) - np.log(self.width)[:, None])

    def log_prior(self) -> float:
        return float((self.log_density + np.log(self.width)[:, None]).sum())

    def _bins(self, actions: Float[Array, "N A"]) -> Int[Array, "N A"]:
        """The bin of each number; a number outside the box is in the first or the last bin."""
        return np.clip((actions - self.low) / self.width, 0, self.log_density.shape[1] - 1).astype(np.int64)
