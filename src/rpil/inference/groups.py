"""One group of scores or two: from M scores and their variances to P(similar).

Demonstration m has the score y_m, a mean over its steps, with the variance v_m of that mean. Two models of the scores:

    one group    y_m ~ N(mu, t + c v_m)
    two groups   y_m ~ p N(mu_1, t_1 + c v_m) + (1 - p) N(mu_0, t_0 + c v_m),      mu_1 > mu_0

These are normal mixtures with known variances of the errors ("extreme deconvolution", Bovy et al. 2011).
c <= 1 is the share of v_m that distinguishes demonstrations: a part of it differs between steps in the same way in all
demonstrations. The two are compared by BIC. If there are two groups, the upper one is similar; if there is one, P is
1/2, but for a trace of the order of the scores. P(similar) is the average over the two models.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import betaincinv, expit, logit

from rpil.inference.settings import GroupSettings
from rpil.numerics.types import Array, Bool, Float, Int

_PROBA_BOUND = 1e-9
"""P(expert) stays so far from 0 and 1 that its logit is finite."""

_TIE_LOG_ODDS = 1e-3
"""Log-odds that keep the order of the scores where P(expert) is at its bound."""


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
    upper = [score > cut for cut in np.unique(np.quantile(score, settings.start_quantiles))]
    one = normals(score, variance, [np.ones((1, len(score)), dtype=bool)], settings)
    two = normals(score, variance, [np.stack([~each, each]) for each in upper], settings)
    if one is None or two is None:
        return single
    # BIC: two groups have three more parameters.
    log_bayes_factor = two.log_likelihood - one.log_likelihood - 1.5 * np.log(len(score))
    return Groups(float(log_bayes_factor), two.mean, two.spread, float(two.share[1]), two.noise, quantiles)


class Normals(NamedTuple):
    """A mixture of K normal groups of scores."""

    log_likelihood: float
    mean: Float[Array, " K"]
    spread: Float[Array, " K"]
    share: Float[Array, " K"]
    noise: float


def normals(
    score: Float[Array, " M"], variance: Float[Array, " M"], starts: list[Bool[Array, "K M"]], settings: GroupSettings
) -> Normals | None:
    """The likeliest mixture of normal groups, by EM with each share of the variance from each of the `starts`, which
    divide the scores; None where none ends in groups of two or more, in the order of the division."""
    every = [(c, start) for c in settings.noise_shares for start in starts if start.sum(axis=1).min() >= 2]
    fits = [_em(score, variance, c, start, settings) for c, start in every]
    return max((fit for fit in fits if fit is not None), key=lambda fit: fit.log_likelihood, default=None)


def _em(
    score: Float[Array, " M"], variance: Float[Array, " M"], noise: float, start: Array, settings: GroupSettings
) -> Normals | None:
    variance, prior = noise * variance, settings.prior_spread * float(score.var())
    counts = start.sum(axis=1)
    mean, share, last = start @ score / counts, counts / counts.sum(), -np.inf
    spread = (start * (score - mean[:, None]) ** 2).sum(axis=1) / counts + prior
    for _ in range(settings.max_iter):
        widths = spread + variance[:, None]
        log_joint = np.log(share) + _log_normal(score[:, None], mean, widths)
        log_evidence = np.logaddexp.reduce(log_joint, axis=1)
        log_likelihood = float(log_evidence.sum())
        penalised = log_likelihood - 0.5 * float((np.log(spread) + prior / spread).sum())
        if penalised - last < settings.tol:
            break
        last = penalised
        responsibility = np.exp(log_joint - log_evidence[:, None])
        counts = responsibility.sum(axis=0)
        share = (counts + 1) / (len(score) + len(counts))
        weight = responsibility / widths
        mean = (weight * score[:, None]).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-300)
        shrinkage = spread / widths
        moment = shrinkage * variance[:, None] + (shrinkage * (score[:, None] - mean)) ** 2
        spread = ((responsibility * moment).sum(axis=0) + prior) / (counts + 1)
    if counts.min() < 2 or (np.diff(mean) <= 0).any():
        return None
    return Normals(log_likelihood, mean, spread, share, noise)


def _log_normal(value: Array, mean: Array, variance: Array) -> Array:
    return np.asarray(-0.5 * np.log(2 * np.pi * variance) - 0.5 * (value - mean) ** 2 / variance)


def expert_share_interval(proba: Float[Array, " M"], p_two: float) -> tuple[float, float, float]:
    """Mean and 95 % interval of the share of experts, given P(expert) of each demonstration: of a Beta posterior where
    two groups are likely, and else of Beta(2, 2)."""
    experts, mean = float(proba.sum()), float(proba.mean())
    a, b = (1 + experts, 1 + len(proba) - experts) if p_two >= 0.5 else (2.0, 2.0)
    low, high = betaincinv(a, b, [0.025, 0.975])
    return mean, min(float(low), mean), max(float(high), mean)
