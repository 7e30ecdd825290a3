"""One group of scores or two: from M numbers with error bars to the probability of being an expert's.

Demonstration m has the score y_m, a mean over its steps, with the variance v_m of that mean. Two models of the scores:

    one group    y_m ~ two-piece normal: mode mu, spreads s_L below and s_R above, each widened by c v_m
    two groups   y_m ~ p N(mu_1, t_1 + c v_m) + (1 - p) N(mu_0, t_0 + c v_m),      mu_1 > mu_0

c <= 1 is the share of v_m that distinguishes demonstrations: what all of them do at the same step differs from step to
step and not between them. The two are compared by BIC. If there are two groups, the upper one is the experts'. If there
is one, the scores are graded: the demonstration of rank r (0 lowest, 1 highest) is an expert's where the share of
adversaries lies below r, with probability I_r(2, 2) under a Beta(2, 2) share. A rank need not mean quality, so this is
shrunk towards 1/2. P(expert) is the average over the two models.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize
from scipy.special import betainc, expit, logit
from scipy.special import logsumexp as log_sum_exp

from rpil.data.archive import stored
from rpil.numerics.types import Array

SURE = 0.9
"""P(two groups) from which they are told apart; below, no demonstration gets a verdict."""

UNSURE = float(logit(SURE))
"""Bound of the log-odds of demonstrations that were not told apart."""

NOISE = (1.0, 0.3, 0.1, 0.03, 0.01)
"""Shares c to choose from, by the likelihood, as far as the effective steps allow: see `LEAST_NOISE`."""

LEAST_NOISE = 0.3
"""Of the variance that independent steps would give: errors are not much smaller than that."""

STARTS = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9)
"""Quantiles at which EM for two groups starts to divide the scores."""

PRIOR_SPREAD = 1 / 16
"""Of the variance of all scores: what the spread of a group is worth before it is seen, one demonstration's weight."""

LEAST_SPREAD = 1e-3
"""Of the variance of all scores, which no group's spread goes below."""

LEAST_APART = 1.0
"""Distance of the two means in their root mean square spread: two groups with one centre are one group with tails."""

TAIL = 0.05
"""Share of experts whose scores are as spread as those of the wider group: a good demonstration may be odd."""

FEWEST_STEPS = 8
"""Steps of the median demonstration from which their mean is about normal."""

RANK_WORTH = 0.6
"""Correlation of a rank with quality, beforehand: P = 1/2 + RANK_WORTH (I_r(2, 2) - 1/2) where scores are graded."""

MOST = 2_000
"""Scores from which the models are fitted; of more, these quantiles."""

_MOST_SURE = 1e-9
_ORDER = 1e-3


@stored(mean="2", spread="2", quantiles="Q")
@dataclass(frozen=True, eq=False)
class Groups:
    """What M scores say.

    Attributes
    ----------
    log_bayes_factor : float
        Two groups against one, nats; minus infinity where demonstrations are too short to tell.
    mean, spread : (2,) arrays
        Of the lower and the upper group; spread is a variance.
    share : float
        Of the upper group.
    noise : float
        c.
    graded : float
        Share of the variance of scores that is no error: 0 where all demonstrations are alike.
    quantiles : (Q,) array
        Of all scores, from the lowest to the highest.
    """

    log_bayes_factor: float
    mean: Array
    spread: Array
    share: float
    noise: float
    graded: float
    quantiles: Array

    @property
    def p_two(self) -> float:
        """P(two groups)."""
        return float(expit(self.log_bayes_factor))

    def bounded(self, log_odds: Array) -> Array:
        """Log-odds (M,) as they are where groups were told apart, else within `UNSURE`."""
        return log_odds if self.p_two >= SURE else UNSURE * np.tanh(log_odds / UNSURE)

    def log_odds(self, score: Array, variance: Array) -> Array:
        """Log-odds of expert against adversary of demonstrations with `score` and its `variance`, (M,) each."""
        at = np.clip(score, *self.mean)  # beyond a group's mean it is no less in that group
        widths = self.spread + self.noise * variance[:, None]
        lower, upper = _log_normal(at[:, None], self.mean, widths).T
        tail = _log_normal(at, self.mean[1], widths.max(axis=1))
        upper = np.logaddexp(np.log1p(-TAIL) + upper, np.log(TAIL) + tail)
        upper = expit(logit(self.share) + upper - lower)
        rank = np.interp(score, self.quantiles, np.linspace(0, 1, len(self.quantiles)))
        rank = np.where(np.ptp(self.quantiles) > 0, rank, 0.5)
        graded = 0.5 + RANK_WORTH * self.graded * (betainc(2, 2, rank) - 0.5)
        proba = self.p_two * upper + (1 - self.p_two) * graded
        # Where the probability saturates the order of the scores remains.
        scale = max(float(np.ptp(self.quantiles)), 1e-300)
        tie = _ORDER * np.tanh((score - np.median(self.quantiles)) / scale)
        found: Array = logit(np.clip(proba, _MOST_SURE, 1 - _MOST_SURE)) + tie
        return found


def fit_groups(score: Array, variance: Array, labels: Array, effective: Array, lengths: Array) -> Groups:
    """The groups of M scores.

    Parameters
    ----------
    score, variance : (M,) arrays
        Mean of a demonstration's steps, and the variance of that mean.
    labels : (M,) int array
        1 known expert, -1 known adversary, 0 unknown.
    effective, lengths : (M,) arrays
        Independent steps that each demonstration is worth, and its steps.
    """
    quantiles = np.quantile(score, np.linspace(0, 1, min(len(score), 201)))
    total = max(float(score.var()), np.finfo(float).tiny)
    graded = max(0.0, 1 - float(np.mean(variance)) / total)
    alike = Groups(-np.inf, np.full(2, score.mean()), np.full(2, total), 0.5, 1.0, graded, quantiles)
    if len(score) < 4 or float(np.median(lengths)) < FEWEST_STEPS or float(np.ptp(score)) == 0.0:
        return alike
    if len(score) > MOST:
        chosen = np.argsort(score, kind="stable")[np.linspace(0, len(score) - 1, MOST).astype(int)]
        score, variance, labels = score[chosen], variance[chosen], labels[chosen]
    least = LEAST_NOISE * float(np.median(np.minimum(effective / lengths, 1.0)))
    noises = [c for c in NOISE if c >= least]
    one = max(one_group(score, c * variance) for c in noises)
    fits = [two_groups(score, variance, labels, c) for c in noises]
    best = max((fit for fit in fits if fit is not None), key=lambda fit: fit[0], default=None)
    if best is None:
        return alike
    log_likelihood, groups = best
    factor = log_likelihood - one - np.log(len(score))  # two parameters more: BIC
    return replace(groups, log_bayes_factor=float(factor), graded=graded, quantiles=quantiles)


def one_group(score: Array, variance: Array) -> float:
    """Log-likelihood of the two-piece normal that fits best; `variance` (M,) widens both sides."""
    deviation = score.std()

    def loss(at: Array) -> float:
        spreads = np.sqrt(np.exp(2 * at[1:, None]) + variance)
        z = (score - at[0]) / np.where(score < at[0], spreads[0], spreads[1])
        return float((0.5 * z * z + np.log(spreads.sum(axis=0)) - np.log(2 / np.sqrt(2 * np.pi))).sum())

    starts = [
        np.array([np.quantile(score, q), np.log(deviation) + skew, np.log(deviation) - skew])
        for q in (0.3, 0.5, 0.7, 0.9)
        for skew in (0.0, 0.7)
    ]
    options = {"maxiter": 1000, "xatol": 1e-5, "fatol": 1e-6}
    scale = np.array([deviation, 1.0, 1.0])
    found = [
        minimize(lambda at: loss(at * scale), start / scale, method="Nelder-Mead", options=options).fun
        for start in starts
    ]
    return -float(min(found))


def two_groups(score: Array, variance: Array, labels: Array, noise: float) -> tuple[float, Groups] | None:
    """Log-likelihood of two normal groups, and the groups, by EM from several starts; labels fix who is in which."""
    total = float(score.var())
    found = [
        _em(score, noise * variance, labels, score > cut, total)
        for cut in np.unique(np.quantile(score, STARTS))
        if 2 <= (score > cut).sum() <= len(score) - 2
    ]
    kept = [fit for fit in found if fit is not None]
    if not kept:
        return None
    log_likelihood, mean, spread, share = max(kept, key=lambda fit: fit[0])
    return log_likelihood, Groups(0.0, mean, spread, share, noise, 0.0, np.zeros(1))


def _em(
    score: Array, variance: Array, labels: Array, upper: Array, total: float, max_iter: int = 300
) -> tuple[float, Array, Array, float] | None:
    known = np.where(labels[:, None] == 0, 0.0, np.where(labels[:, None] * np.array([-1, 1]) > 0, 0.0, -np.inf))
    mean = np.array([score[~upper].mean(), score[upper].mean()])
    spread = np.array([score[~upper].var(), score[upper].var()]) + LEAST_SPREAD * total
    share, before = float(upper.mean()), -np.inf
    for _ in range(max_iter):
        widths = spread + variance[:, None]
        joint = np.log([1 - share, share]) + _log_normal(score[:, None], mean, widths) + known
        each = log_sum_exp(joint, axis=1)
        log_likelihood = float(each.sum())
        penalised = log_likelihood - 0.5 * float((np.log(spread) + PRIOR_SPREAD * total / spread).sum())
        if penalised - before < 1e-4:
            break
        before = penalised
        belongs = np.exp(joint - each[:, None])
        counts = belongs.sum(axis=0)
        share = float((counts[1] + 1) / (len(score) + 2))
        weight = belongs / widths
        mean = (weight * score[:, None]).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-300)
        shrink = spread / widths
        moment = shrink * variance[:, None] + (shrink * (score[:, None] - mean)) ** 2
        spread = ((belongs * moment).sum(axis=0) + PRIOR_SPREAD * total) / (counts + 1)
        spread = np.maximum(spread, LEAST_SPREAD * total)
    if counts.min() < 2 or mean[1] - mean[0] < LEAST_APART * np.sqrt(spread.mean()):
        return None
    return log_likelihood, mean, spread, share


def _log_normal(value: Array, mean: Array, variance: Array) -> Array:
    density: Array = -0.5 * np.log(2 * np.pi * variance) - 0.5 * (value - mean) ** 2 / variance
    return density


def share_interval(proba: Array, p_two: float) -> tuple[float, float, float]:
    """Mean and 95 % interval of the share of experts: of the groups, or anything a Beta(2, 2) allows."""
    from scipy.stats import beta

    experts = float(proba.sum())
    known = p_two >= 0.5
    a, b = (1 + experts, 1 + len(proba) - experts) if known else (2.0, 2.0)
    low, high = beta.ppf([0.025, 0.975], a, b)
    mean = float(proba.mean())
    return mean, min(float(low), mean), max(float(high), mean)
