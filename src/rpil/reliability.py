"""How reliable experts and adversaries are: two Beta distributions over rho, on a grid.

A demonstration's reliability rho is the share of its steps that are the expert's. The group of the demonstration says
where rho comes from: Beta(a, b) near 1 for experts, a lower one for adversaries. The paper's model is the limit of
point masses at 1 and 0. On a grid of rho every integral is a sum, and choosing (a, b) from a table makes that M-step
exact: one matrix product and an argmax.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from typing import Protocol, Self

import numpy as np
from scipy.special import logsumexp, xlogy

from rpil.passes import Array

EXPERT, ADVERSARY = 0, 1


class Reliability(Protocol):
    """What EM needs to know of reliabilities."""

    @property
    def nodes(self) -> Array:
        """Grid of rho, (J,)."""

    @property
    def log_weight(self) -> Array:
        """log P(rho_j | group), (2, J): experts, adversaries."""

    def fit(self, counts: Array) -> Self:
        """The distributions that explain expected `counts` (2, J) of demonstrations no worse."""

    def log_prior(self) -> float:
        """What the prior on the two distributions adds to the objective."""


@dataclass(frozen=True)
class PointMasses:
    """The paper's demonstration-level model: every step of an expert is the expert's, none of an adversary's is."""

    nodes: Array = field(default_factory=lambda: np.array([0.0, 1.0]))
    log_weight: Array = field(default_factory=lambda: np.array([[-np.inf, 0.0], [0.0, -np.inf]]))

    def fit(self, counts: Array) -> PointMasses:
        return self

    def log_prior(self) -> float:
        return 0.0


@dataclass(frozen=True)
class BetaTable:
    """Candidates for the two Betas, all log-concave (a, b >= 1), with their weights on the grid."""

    nodes: Array
    mean: Array
    concentration: Array
    log_weight: Array
    log_prior: Array
    """(2, T): of each candidate for experts and for adversaries."""


_N_NODES = 32
_MEANS = np.array([0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.93, 0.96, 0.98])
_CONCENTRATIONS = np.array([2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0])


@cache
def beta_table() -> BetaTable:
    """The one table, made at first use."""
    angle = (np.arange(_N_NODES) + 0.5) * np.pi / _N_NODES
    nodes = 0.5 * (1 - np.cos(angle))  # Chebyshev: dense at both ends, where reliabilities are
    mean, concentration = (grid.ravel() for grid in np.meshgrid(_MEANS, _CONCENTRATIONS, indexing="ij"))
    a, b = mean * concentration, (1 - mean) * concentration
    # The modes at the ends have a = 1 or b = 1; candidates beyond are moved there, keeping the mean.
    a, b = np.where(b < 1, mean / (1 - mean), a), np.maximum(b, 1)
    a, b = np.maximum(a, 1), np.where(a < 1, (1 - mean) / mean, b)
    a, b = np.unique(np.round(np.stack([a, b]), 9), axis=1)
    log_weight = xlogy(a[:, None] - 1, nodes) + xlogy(b[:, None] - 1, 1 - nodes) + np.log(np.sin(angle))
    log_weight -= logsumexp(log_weight, axis=1, keepdims=True)
    mean, concentration = a / (a + b), a + b
    # Experts mostly follow the expert, which is worth four steps. Certainty is for one group only: an adversary's
    # density vanishes at rho = 1 and an expert's at 0, or the ends would speak for neither.
    log_prior = np.stack([np.where(a >= 2, 4.0 * np.log(mean), -np.inf), np.where(b >= 2, 0.0, -np.inf)])
    return BetaTable(nodes, mean, concentration, log_weight, log_prior)


@dataclass(frozen=True)
class TwoBetas:
    """Reliability of experts and adversaries: two rows of the table, the experts' mean higher by at least `gap`."""

    expert: int
    adversary: int
    gap: float = 0.1

    @classmethod
    def start(cls, expert: float = 0.95, adversary: float = 0.3) -> TwoBetas:
        """Betas with about these means, as spread out as the table has them."""
        table = beta_table()

        def nearest(mean: float) -> int:
            return int(np.argmin(np.abs(table.mean - mean) + 1e-4 * table.concentration))

        return cls(nearest(expert), nearest(adversary))

    @property
    def nodes(self) -> Array:
        return beta_table().nodes

    @property
    def log_weight(self) -> Array:
        return beta_table().log_weight[[self.expert, self.adversary]]

    def fit(self, counts: Array) -> TwoBetas:
        table = beta_table()
        score = counts @ table.log_weight.T + table.log_prior
        pair = score[EXPERT][:, None] + score[ADVERSARY]
        pair[table.mean[:, None] < table.mean + self.gap] = -np.inf
        best = int(np.argmax(pair))
        expert, adversary = divmod(best, len(table.mean))
        return replace(self, expert=expert, adversary=adversary)

    def log_prior(self) -> float:
        prior = beta_table().log_prior
        return float(prior[EXPERT, self.expert] + prior[ADVERSARY, self.adversary])

    @property
    def means(self) -> tuple[float, float]:
        """Mean reliability of experts and of adversaries."""
        mean = beta_table().mean
        return float(mean[self.expert]), float(mean[self.adversary])
