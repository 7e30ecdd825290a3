"""The prior P(expert) of the mixture."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import betaincinv

from rpil.data.archive import stored
from rpil.data.errors import DataError
from rpil.numerics.types import Array, Float


@stored()
@dataclass(frozen=True)
class ExpertPrior:
    """P(expert) = p, the same for all demonstrations: fixed, or estimated under Beta(a, b)."""

    p: float = 0.5
    a: float = 2.0
    b: float = 2.0
    fixed: bool = False

    @property
    def log(self) -> Float[Array, " 2"]:
        """log p and log (1 - p)."""
        return np.array([np.log(self.p), np.log1p(-self.p)])

    def fit(self, expert: Float[Array, " M"]) -> ExpertPrior:
        """With p at its posterior mode, given the responsibilities `expert`."""
        if self.fixed:
            return self
        p = (expert.sum() + self.a - 1) / (len(expert) + self.a + self.b - 2)
        return replace(self, p=float(np.clip(p, 1e-12, 1 - 1e-12)))

    def log_prior(self) -> float:
        """log density of Beta(a, b) at p, less its constant: a term of the objective."""
        return 0.0 if self.fixed else float(np.dot([self.a - 1, self.b - 1], self.log))

    def interval(self, expert: Float[Array, " M"]) -> tuple[float, float, float]:
        """Posterior mean of p and the ends of its 95 % interval, given the responsibilities `expert`.

        Their sums stand for the unknown numbers of experts and adversaries.
        """
        if self.fixed:
            return self.p, self.p, self.p
        a, b = self.a + float(expert.sum()), self.b + float((1.0 - expert).sum())
        low, high = betaincinv(a, b, [0.025, 0.975])
        return a / (a + b), float(low), float(high)


def as_prior(prior: float | tuple[float, float] | None) -> ExpertPrior:
    """The prior that a user describes: a fixed P(expert), or (a, b) of its Beta prior; None is Beta(2, 2).

    A `DataError` where P(expert) is not between 0 and 1, or a or b is below 1.
    """
    if prior is None:
        return ExpertPrior()
    if isinstance(prior, tuple | list | np.ndarray):
        a, b = (float(value) for value in prior)
        if a < 1 or b < 1:
            raise DataError(f"The Beta prior ({a}, {b}) has no single mode; give both numbers as 1 or more.")
        return ExpertPrior(a / (a + b), a, b)
    if not 0 < float(prior) < 1:
        raise DataError(f"The prior {prior!r} is no probability between 0 and 1.")
    return ExpertPrior(float(prior), fixed=True)
