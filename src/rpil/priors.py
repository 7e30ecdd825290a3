"""P(expert) before the actions of a demonstration are looked at: one share for all demonstrations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import betaincinv

from rpil.passes import Array, Sums


@dataclass(frozen=True)
class Share:
    """P(expert) is the same for all: fixed, or estimated under Beta(a, b)."""

    p: float = 0.5
    a: float = 2.0
    b: float = 2.0
    fixed: bool = False

    @property
    def log_odds(self) -> float:
        """logit P(expert)."""
        return float(np.log(self.p) - np.log1p(-self.p))

    @property
    def log(self) -> Array:
        """log P(expert), log P(adversary), (2,)."""
        return np.array([np.log(self.p), np.log1p(-self.p)])

    def fit(self, expert: Array) -> Share:
        """The posterior mode, given the responsibilities `expert` (M,)."""
        return self.improved(self.statistics(expert))

    def statistics(self, expert: Array) -> Sums:
        """Expected experts among some of the demonstrations, and the number of these demonstrations."""
        return expert.sum(), len(expert)

    def improved(self, statistics: Sums) -> Share:
        """The posterior mode, given the statistics of all demonstrations."""
        if self.fixed:
            return self
        experts, everybody = statistics
        p = (experts + self.a - 1) / (everybody + self.a + self.b - 2)
        return replace(self, p=float(np.clip(p, 1e-12, 1 - 1e-12)))

    def log_prior(self) -> float:
        """What Beta(a, b) adds to the objective."""
        return 0.0 if self.fixed else float(np.dot([self.a - 1, self.b - 1], self.log))

    def interval(self, expert: Array) -> tuple[float, float, float]:
        """Posterior mean of the share and the ends of its 95 % interval, given the responsibilities `expert` (M,).

        The expected numbers of experts and adversaries stand for the unknown true ones.
        """
        if self.fixed:
            return self.p, self.p, self.p
        a, b = self.a + float(expert.sum()), self.b + float((1.0 - expert).sum())
        low, high = betaincinv(a, b, [0.025, 0.975])
        return a / (a + b), float(low), float(high)
