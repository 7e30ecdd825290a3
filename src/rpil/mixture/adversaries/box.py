"""Adversaries with continuous actions: densities psi(a|s) over a box."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.mixture.adversaries.protocol import Fixed
from rpil.numerics.types import Array

_N_BINS = 20


@stored()
@dataclass(frozen=True)
class UniformBox(Fixed):
    """psi = 1 / volume: does anything within the box."""

    log_volume: float
    name: str = "uniform"

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        return np.full(len(actions), -self.log_volume)


@stored(low="A", width="A", log_density="A B")
@dataclass(frozen=True, eq=False)
class MarginalBox(Fixed):
    """A histogram of each dimension: does what it likes best, whatever the state.

    Every bin has a Dirichlet prior worth one step, so that nothing is ever impossible.

    Attributes
    ----------
    low, width : (A,) arrays
        Where the bins of each dimension begin, and how wide one is.
    log_density : (A, B) array
    """

    low: Array
    width: Array
    log_density: Array
    name: str = "marginal"

    @classmethod
    def start(cls, box: Box) -> MarginalBox:
        span = box.high - box.low
        return cls(box.low, span / _N_BINS, np.tile(-np.log(span)[:, None], (1, _N_BINS)))

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        return np.take_along_axis(self.log_density, self._bins(actions).T, axis=1).sum(axis=0)

    def fit(self, data: FitData, outputs: Array, weight: Array) -> MarginalBox:
        bins = self._bins(data.actions)
        counts = 1.0 + np.stack([np.bincount(column, weight, minlength=_N_BINS) for column in bins.T])
        share = counts / counts.sum(axis=1, keepdims=True)
        return replace(self, log_density=np.log(share) - np.log(self.width)[:, None])

    def log_prior(self) -> float:
        return float((self.log_density + np.log(self.width)[:, None]).sum())

    def _bins(self, actions: Array) -> Array:
        """The bin of each number, (N, A); what lies outside the box counts to the last one."""
        return np.clip((actions - self.low) / self.width, 0, _N_BINS - 1).astype(np.int64)
