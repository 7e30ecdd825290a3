"""One group of scores or two: from M scores and their variances to P(similar).

Demonstration m has the score y_m, a mean over its steps, with the variance v_m of that mean. Two models of the scores:

    one group    y_m ~ two-piece normal: mode mu, spreads s_L below and s_R above, each widened by c v_m
    two groups   y_m ~ p N(mu_1, t_1 + c v_m) + (1 - p) N(mu_0, t_0 + c v_m),      mu_1 > mu_0

The second is a normal mixture with known variances of the errors ("extreme deconvolution", Bovy et al. 2011).
c <= 1 is the share of v_m that distinguishes demonstrations: a part of it differs between steps in the same way in all
demonstrations. The two are compared by BIC. If there are two groups, the upper one is similar; if there is one, P is
1/2, but for a trace of the order of the scores. P(similar) is the average over the two models.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import betaincinv, expit, logit

from rpil.inference.settings import GroupSettings
from rpil.numerics.types import Array, Bool, Float, Int

_PROBA_BOUND = 1e-9
"""P(expert) stays so far from 0 and 1 that its logit is finite."""

_TIE_LOG_ODDS = 1e-3
"""Log-odds that keep the order of the scores where P(expert) is at its bound."""

BFGS_STEPS, BFGS_GAIN = 200, 1e-10
"""Steps of `least_within` at most, and the gain, relative to the value, at which it ends."""
_MIN_VARIANCE = 1e-6
_MAX_LOG_SPREAD = 3.0
"""Bounds of variances and log spreads in `one_group`, in standard deviations of the scores."""


@dataclass(frozen=True, eq=False)
class Groups:
    """One or two groups, fitted to M scores."""

    log_bayes_factor: float
    """Two groups against one, nats; minus infinity where two groups were not fitted."""
    mean: Float[Array, " 2"]
    spread: Float[Array, " 2"]
    """Means and spreads of the lower and the upper group; spread is a variance."""
    share: float
    """Share of the upper group."""
    noise: float
    """The share c of the variance of a score."""
    quantiles: Float[Array, " Q"]
    """Quantiles of all scores, from the lowest to the highest."""

    @property
    def p_two(self) -> float:
        """P(two groups)."""
        return float(expit(self.log_bayes_factor))

    @property
    def distance(self) -> float:
        """Distance of the upper mean from the lower one, in standard deviations of the wider group."""
        return float((self.mean[1] - self.mean[0]) / np.sqrt(self.spread.max()))

    def upper(self, score: Float[Array, " M"], variance: Float[Array, " M"]) -> Bool[Array, " M"]:
        """The members of the upper group, whether or not there are two."""
        return np.asarray(replace(self, log_bayes_factor=np.inf).log_odds(score, variance) > 0)

    def log_odds(self, score: Float[Array, " M"], variance: Float[Array, " M"]) -> Float[Array, " M"]:
        """Log-odds of expert against adversary, nats, of demonstrations with these scores and their variances."""
        inside = np.clip(score, *self.mean)  # a score beyond the mean of a group counts as that mean
        widths = self.spread + self.noise * variance[:, None]
        lower, upper = _log_normal(inside[:, None], self.mean, widths).T
        p_upper = expit(logit(self.share) + upper - lower)
        proba = self.p_two * p_upper + (1 - self.p_two) / 2
        scale = max(float(np.ptp(self.quantiles)), 1e-300)
        tie = _TIE_LOG_ODDS * np.tanh((score - np.median(self.quantiles)) / scale)
        return np.asarray(logit(np.clip(proba, _PROBA_BOUND, 1 - _PROBA_BOUND)) + tie)


def fit_groups(
    score: Float[Array, " M"],
    variance: Float[Array, " M"],
    lengths: Int[Array, " M"],
    settings: GroupSettings,
) -> Groups:
    """The groups of M scores, means over as many steps as `lengths` says, and whose `variance` is given."""
    quantiles = np.quantile(score, np.linspace(0, 1, min(len(score), 201)))
    total = max(float(score.var()), float(np.finfo(float).tiny))
    single = Groups(-np.inf, np.full(2, score.mean()), np.full(2, total), 0.5, 1.0, quantiles)
    if float(np.median(lengths)) < settings.min_steps or float(np.ptp(score)) == 0.0:
        return single
    if len(score) > settings.max_scores:
        spaced = np.linspace(0, len(score) - 1, settings.max_scores).astype(int)
        chosen = np.argsort(score, kind="stable")[spaced]
        score, variance = score[chosen], variance[chosen]
    one = max(one_group(score, c * variance) for c in settings.noise_shares)
    two = two_groups(score, variance, settings)
    if two is None:
        return single
    log_likelihood, groups = two
    log_bayes_factor = log_likelihood - one - np.log(len(score))  # BIC: two groups have two more parameters
    return replace(groups, log_bayes_factor=float(log_bayes_factor), quantiles=quantiles)


def one_group(score: Float[Array, " M"], variance: Float[Array, " M"]) -> float:
    """Log-likelihood of the best two-piece normal, whose spreads are widened by `variance`."""
    deviation = score.std()
    y, variance = (score - score.mean()) / deviation, np.maximum(variance / deviation**2, _MIN_VARIANCE)
    least = variance.min()

    def loss(parameters: Array) -> tuple[float, Array]:
        """At the mode and, for both sides, half of log(s^2 + the least variance), where no slope vanishes."""
        own = np.exp(2 * parameters[1:, None])
        spreads = np.sqrt(own + (variance - least))
        below = y < parameters[0]
        side, total = np.where(below, *spreads), spreads.sum(axis=0)
        z = (y - parameters[0]) / side
        slopes = own / spreads * (1 / total - np.where([below, ~below], z * z / side, 0.0))
        return float(0.5 * (z @ z) + np.log(total).sum()), np.append(-(z / side).sum(), slopes.sum(axis=1))

    low = 0.5 * np.log(least)
    high = max(_MAX_LOG_SPREAD, low + 1.0)  # scores may differ by less than their noise
    bounds = np.array([[y.min(), y.max()], [low, high], [low, high]])
    # From all scores on one side of the mode. More starts found a better optimum, by .4 nats, in five of 400 vectors.
    starts = [np.clip([mode, 0.0, 0.0], *bounds.T) for mode in bounds[0]]
    constant = np.log(2 / np.sqrt(2 * np.pi)) - np.log(deviation)
    return float(len(y) * constant - min(least_within(loss, start, bounds) for start in starts))


def least_within(loss: Callable[[Array], tuple[float, Array]], x: Array, bounds: Float[Array, "D 2"]) -> float:
    """The least value of a `loss`, which has its gradient beside it, from `x` on within bounds: by BFGS, in which
    parameters at a bound rest. To import `scipy.optimize` takes longer than all that is fitted with it."""
    (value, slope), inverse = loss(x), np.eye(len(x))
    for _ in range(BFGS_STEPS):
        free = ~(((x <= bounds[:, 0]) & (slope > 0)) | ((x >= bounds[:, 1]) & (slope < 0)))
        step = -np.where(free, inverse @ np.where(free, slope, 0.0), 0.0)
        step /= max(1.0, np.abs(step).max())
        for length in 0.5 ** np.arange(30):
            moved = np.clip(x + length * step, *bounds.T)
            now, new_slope = loss(moved)
            if now <= value + 1e-4 * slope @ (moved - x):
                break
        gain, change, turned = value - now, moved - x, new_slope - slope
        if gain <= BFGS_GAIN * max(abs(value), 1.0):
            return min(value, now)
        x, value, slope = moved, now, new_slope
        if (curvature := float(change @ turned)) > 0:
            shift = np.eye(len(x)) - np.outer(change, turned) / curvature
            inverse = shift @ inverse @ shift.T + np.outer(change, change) / curvature
    return value


def two_groups(
    score: Float[Array, " M"], variance: Float[Array, " M"], settings: GroupSettings
) -> tuple[float, Groups] | None:
    """Log-likelihood of two normal groups, and the groups, by EM with each share of the variance, from several starts;
    None where no start ends in two groups."""
    starts = [score > cut for cut in np.unique(np.quantile(score, settings.start_quantiles))]
    starts = [upper for upper in starts if 2 <= upper.sum() <= len(score) - 2]
    fits = [_two_normals(score, variance, c, upper, settings) for c in settings.noise_shares for upper in starts]
    return max((fit for fit in fits if fit is not None), key=lambda fit: fit[0], default=None)


def _two_normals(
    score: Array, variance: Array, noise: float, upper: Array, settings: GroupSettings
) -> tuple[float, Groups] | None:
    """EM for two normal groups from the division `upper` (M,) bool: log-likelihood and groups; None where a group is
    empty or above the other."""
    variance, prior = noise * variance, settings.prior_spread * float(score.var())
    mean = np.array([score[~upper].mean(), score[upper].mean()])
    spread = np.array([score[~upper].var(), score[upper].var()]) + prior
    share, last = float(upper.mean()), -np.inf
    for _ in range(settings.max_iter):
        widths = spread + variance[:, None]
        log_joint = np.log([1 - share, share]) + _log_normal(score[:, None], mean, widths)
        log_evidence = np.logaddexp(*log_joint.T)
        log_likelihood = float(log_evidence.sum())
        penalised = log_likelihood - 0.5 * float((np.log(spread) + prior / spread).sum())
        if penalised - last < settings.tol:
            break
        last = penalised
        responsibility = np.exp(log_joint - log_evidence[:, None])
        counts = responsibility.sum(axis=0)
        share = float((counts[1] + 1) / (len(score) + 2))
        weight = responsibility / widths
        mean = (weight * score[:, None]).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-300)
        shrinkage = spread / widths
        moment = shrinkage * variance[:, None] + (shrinkage * (score[:, None] - mean)) ** 2
        spread = ((responsibility * moment).sum(axis=0) + prior) / (counts + 1)
    if counts.min() < 2 or mean[1] <= mean[0]:
        return None
    return log_likelihood, Groups(0.0, mean, spread, share, noise, np.zeros(1))


def _log_normal(value: Array, mean: Array, variance: Array) -> Array:
    return np.asarray(-0.5 * np.log(2 * np.pi * variance) - 0.5 * (value - mean) ** 2 / variance)


def expert_share_interval(proba: Float[Array, " M"], p_two: float) -> tuple[float, float, float]:
    """Mean and 95 % interval of the share of experts, given P(expert) of each demonstration: of a Beta posterior where
    two groups are likely, and else of Beta(2, 2)."""
    experts, mean = float(proba.sum()), float(proba.mean())
    a, b = (1 + experts, 1 + len(proba) - experts) if p_two >= 0.5 else (2.0, 2.0)
    low, high = betaincinv(a, b, [0.025, 0.975])
    return mean, min(float(low), mean), max(float(high), mean)
