"""The prior P(expert): a fixed share, or one estimated under a Beta prior."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import betaincinv

from rpil.data.archive import stored
from rpil.data.errors import DataError
from rpil.numerics.types import Array


@stored()
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
        if self.fixed:
            return self
        p = (expert.sum() + self.a - 1) / (len(expert) + self.a + self.b - 2)
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


def as_prior(prior: float | tuple[float, float] | None) -> Share:
    """P(expert): fixed, or estimated under Beta(a, b); None is Beta(2, 2)."""
    if prior is None:
        return Share()
    if np.ndim(prior) == 0:
        if not 0 < float(prior) < 1:  # type: ignore[arg-type]
            raise DataError(f"The prior {prior!r} is no probability between 0 and 1.")
        return Share(float(prior), fixed=True)  # type: ignore[arg-type]
    a, b = (float(value) for value in prior)  # type: ignore[union-attr]
    if a < 1 or b < 1:
        raise DataError(f"The Beta prior ({a}, {b}) has no single mode; give both numbers as 1 or more.")
    return Share((a / (a + b)), a, b)
