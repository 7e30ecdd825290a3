"""P(expert) before a demonstration's actions are looked at: one share for all, or one that depends on the length.

People who fumble take longer, or give up earlier; whose trial is timed, do less in it. Which it is differs from task to
task, so nothing is assumed: the length has a slope that is learned with everything else, from demonstrations whose
actions speak for themselves. It moves nothing where the actions say nothing: a mixture whose groups explain all
demonstrations alike has the same likelihood for every slope, and the slope's own prior is at zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from scipy.special import expit, log_expit, logit

from rpil.passes import Array, Sums


class Prior(Protocol):
    """What EM needs of a prior; instances are immutable."""

    @property
    def p(self) -> float:
        """P(expert), of a demonstration of ordinary length."""

    @property
    def fixed(self) -> bool:
        """Whether it is given, and not learned."""

    def log_odds(self, lengths: Array) -> Array:
        """logit P(expert) of demonstrations with so many steps, (M,)."""

    def log(self, lengths: Array) -> Array:
        """log P(expert), log P(adversary), (M, 2)."""

    def fit(self, expert: Array, lengths: Array) -> Self:
        """The prior that explains the responsibilities `expert` (M,) no worse."""

    def statistics(self, expert: Array, lengths: Array) -> Sums:
        """What some of the demonstrations tell, as sums."""

    def improved(self, statistics: Sums, radius: float = ...) -> Self:
        """The prior after one improving step, given the statistics of all; no number moves further than `radius`."""

    def log_prior(self) -> float:
        """What the prior on its own parameters adds to the objective."""

    def alternatives(self, lengths: Array) -> tuple[Array, Array]:
        """Other shares: what each adds to the log-odds, and its log-prior up to a constant, both (P,).

        They are dense around the fitted share, as dense as so many demonstrations need, and reach far.
        """


@dataclass(frozen=True)
class Share:
    """P(expert) is the same for all: fixed, or estimated under Beta(a, b)."""

    p: float = 0.5
    a: float = 2.0
    b: float = 2.0
    fixed: bool = False

    def log_odds(self, lengths: Array) -> Array:
        return np.full(len(lengths), np.log(self.p) - np.log1p(-self.p))

    def log(self, lengths: Array) -> Array:
        return np.tile([np.log(self.p), np.log1p(-self.p)], (len(lengths), 1))

    def fit(self, expert: Array, lengths: Array) -> Share:
        """The posterior mode after ``expert.sum()`` expected experts."""
        return self.improved(self.statistics(expert, lengths))

    def statistics(self, expert: Array, lengths: Array) -> Sums:
        return expert.sum(), len(expert)

    def improved(self, statistics: Sums, radius: float = np.inf) -> Share:
        if self.fixed:
            return self
        experts, everybody = statistics
        p = (experts + self.a - 1) / (everybody + self.a + self.b - 2)
        return replace(self, p=float(np.clip(p, 1e-12, 1 - 1e-12)))

    def log_prior(self) -> float:
        return 0.0 if self.fixed else float(np.dot([self.a - 1, self.b - 1], self.log(np.ones(1))[0]))

    def alternatives(self, lengths: Array) -> tuple[Array, Array]:
        return (np.zeros(1), np.zeros(1)) if self.fixed else _shares(self, lengths)


@dataclass(frozen=True)
class ByLength:
    """logit P(expert) = intercept + slope z, with z the standardised logarithm of the length, at most 2 either way.

    A mixture with a concomitant variable (Dayton and Macready 1988). At ordinary length P(expert) has the prior
    Beta(a, b); the slope N(0, 2.5^2), the scale that Gelman et al. (2008) recommend for standardised predictors. The
    limit keeps one demonstration of extreme length from being judged by a line through the others.

    Attributes
    ----------
    center, scale : float
        Mean and standard deviation of the logarithm of the lengths that were fitted.
    """

    center: float
    scale: float
    intercept: float = 0.0
    slope: float = 0.0
    a: float = 2.0
    b: float = 2.0
    fixed: bool = False

    @classmethod
    def start(cls, lengths: Array, a: float = 2.0, b: float = 2.0) -> ByLength:
        """No slope yet, and the mean of Beta(a, b); a scale of 1 where all lengths are the same."""
        logarithm = np.log(lengths)
        spread = float(logarithm.std())
        return cls(float(logarithm.mean()), spread if spread > 1e-9 else 1.0, float(np.log(a / b)), a=a, b=b)

    @property
    def p(self) -> float:
        return float(expit(self.intercept))

    def log_odds(self, lengths: Array) -> Array:
        """logit P(expert | length), (M,)."""
        return self.intercept + self.slope * self._standardised(lengths)

    def log(self, lengths: Array) -> Array:
        log_odds = self.log_odds(lengths)
        return np.stack([log_expit(log_odds), log_expit(-log_odds)], axis=1)

    def fit(self, expert: Array, lengths: Array) -> ByLength:
        """Newton steps, each shortened until it is none back."""
        z = self._standardised(lengths)
        # The Beta prior is a - 1 experts and b - 1 adversaries of ordinary length.
        design = np.stack([np.append(np.ones(len(z)), 1.0), np.append(z, 0.0)], axis=1)
        target = np.append(expert, self.a - 1)
        weight = np.append(np.ones(len(z)), self.a + self.b - 2)
        penalty = np.array([0.0, _SLOPE**-2])

        def loss(theta: Array) -> float:
            logit = design @ theta
            likelihood = target @ log_expit(logit) + (weight - target) @ log_expit(-logit)
            return float(0.5 * penalty @ theta**2 - likelihood)

        theta = np.array([self.intercept, self.slope])
        for _ in range(_NEWTON):
            p = expit(design @ theta)
            gradient = design.T @ (weight * p - target) + penalty * theta
            hessian = (design.T * (weight * p * (1 - p) + 1e-9)) @ design + np.diag(penalty)
            step, here = np.linalg.solve(hessian, gradient), loss(theta)
            while loss(theta - step) > here and np.abs(step).max() > 1e-12:
                step = 0.5 * step
            theta = theta - step
            if np.abs(step).max() < 1e-9:
                break
        intercept, slope = theta
        return replace(self, intercept=float(np.clip(intercept, -_MOST, _MOST)), slope=float(slope))

    def statistics(self, expert: Array, lengths: Array) -> Sums:
        """Gradient and Hessian of the log-likelihood."""
        design = np.stack([np.ones(len(lengths)), self._standardised(lengths)], axis=1)
        p = expit(self.log_odds(lengths))
        return design.T @ (expert - p), (design.T * (p * (1 - p))) @ design

    def improved(self, statistics: Sums, radius: float = np.inf) -> ByLength:
        """One Newton step of limited length."""
        slope, curvature = statistics
        theta, p = np.array([self.intercept, self.slope]), self.p
        precision = np.array([0.0, _SLOPE**-2])
        slope = slope + np.array([self.a - 1 - (self.a + self.b - 2) * p, 0.0]) - precision * theta
        curvature = curvature + np.diag([(self.a + self.b - 2) * p * (1 - p) + 1e-9, precision[1]])
        longest = min(radius, _STEP)
        step = np.clip(np.linalg.solve(curvature, slope), -longest, longest)
        intercept, slope = theta + step
        return replace(self, intercept=float(np.clip(intercept, -_MOST, _MOST)), slope=float(slope))

    def _standardised(self, lengths: Array) -> Array:
        return np.clip((np.log(lengths) - self.center) / self.scale, -_EXTREME, _EXTREME)

    def log_prior(self) -> float:
        share = (self.a - 1) * log_expit(self.intercept) + (self.b - 1) * log_expit(-self.intercept)
        return float(share - 0.5 * (self.slope / _SLOPE) ** 2)

    def alternatives(self, lengths: Array) -> tuple[Array, Array]:
        return _shares(self, lengths)


def _shares(prior: Share | ByLength, lengths: Array) -> tuple[Array, Array]:
    p = expit(prior.log_odds(lengths))
    deviation = ((p * (1 - p)).sum() + (prior.a + prior.b) * prior.p * (1 - prior.p)) ** -0.5
    u = np.linspace(-1.0, 1.0, _N_SHARES) * np.arcsinh(_WIDE / deviation)
    shift = deviation * np.sinh(u)
    log_odds = logit(prior.p) + shift
    # Beta's density on the scale of log-odds, times the spacing of the grid.
    return shift, prior.a * log_expit(log_odds) + prior.b * log_expit(-log_odds) + np.log(np.cosh(u))


_N_SHARES = 41
_WIDE = 7.0
_SLOPE = 2.5
_EXTREME = 2.0
_NEWTON = 25
_STEP = 2.0
_MOST = 25.0
