"""Evidence of who is good: a Bayesian logistic regression, and witnesses whose reliability and sign are learned.

    P(m is good | x_m) = sigmoid(x_m w),   w ~ N(w_0, Lambda^-1),   log p(evidence) = log[s e^{L/2} + (1 - s) e^{-L/2}]

s is that probability, or of a pair "i is better than j" sigmoid((x_i - x_j) w). L is the log-likelihood ratio of all
that is known of it. An answer is wrong at one rate. A witness is a column, such as a flag, a grade or a reward; it has
levels l, and

    L_m = log P(l_m | good) - log P(l_m | bad),     of all witnesses: their sum

Reliabilities are estimated by EM (Dawid and Skene 1979). Each is learned from all that others say of a demonstration:
the regression on answers and on other witnesses (Raykar et al. 2010), but for the witness that is most alike. So two
that err together do not confirm each other; equal ones count as one. One that is not confirmed counts for nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.special import expit, log_expit

from rpil.inference.settings import AnswerSettings
from rpil.numerics.regression import mean_ranks
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.policies.folds import out_of_fold

NOTHING = 1e6
"""Precision of weights that are 0."""
MAX_ITER, TOL = 50, 1e-8
"""Iterations at most, and the gain in nats, and the share of a step, at which they stop."""
CHANCE = 2.5
"""Nats by which columns explain a witness at the level of chance."""
N_FOLDS = 5
"""Folds of demonstrations."""
TOO_ALIKE = 0.8
"""Correlation of two witnesses from which they are taken for one."""
MAX_ROUNDS, ENOUGH = 12, 0.02
"""Rounds of EM at most, and the change of evidence in nats at which it stops."""


def regression(
    rows: Float[Array, "R D"], evidence: Float[Array, " R"], n_pairs: int, settings: AnswerSettings, at: slice | Array
) -> Float[Array, " _"]:
    """Log-odds of the rows `at`, nearer to 0 the less is known (MacKay 1992), given the log-likelihood ratio L of each
    row; the last `n_pairs` rows are pairs.

    Where all is of one side, the offset alone moves.
    """
    anchor, precision = np.zeros(rows.shape[1]), np.full(rows.shape[1], float(settings.precision))
    anchor[1], anchor[-1] = settings.by_ranking, settings.by_group
    if not is_contrast(evidence, n_pairs):
        precision[1:] = NOTHING
    known = evidence != 0
    mean, covariance = laplace(rows[known], evidence[known], anchor, precision)
    variance = np.einsum("md,de,me->m", rows[at], covariance, rows[at])
    return np.asarray(rows[at] @ mean / np.sqrt(1 + np.pi * variance / 8))


def is_contrast(evidence: Float[Array, " R"], n_pairs: int) -> bool:
    """Whether some of it is for good and some for bad, or of a pair, which holds both."""
    single, of_pairs = np.split(evidence, [len(evidence) - n_pairs])
    return bool(((single > 0).any() and (single < 0).any()) or of_pairs.any())


def held_out(rows: Float[Array, "R D"], evidence: Float[Array, " M"], settings: AnswerSettings) -> Float[Array, " M"]:
    """Log-odds of the first M rows by the evidence of other folds."""
    single, fold = rows[: len(evidence)], np.arange(len(evidence)) % N_FOLDS
    return out_of_fold(fold, lambda _, test: regression(single, np.where(test, 0.0, evidence), 0, settings, test))


def laplace(rows: Array, evidence: Array, anchor: Array, precision: Array) -> tuple[Array, Array]:
    """Mean and covariance of the Laplace approximation of w, by Fisher scoring with halved steps."""
    right = expit(np.abs(evidence))  # how often evidence of this strength is right

    def log_joint(w: Array) -> float:
        yes, no = log_expit(rows @ w) + evidence / 2, log_expit(-(rows @ w)) - evidence / 2
        return float(np.logaddexp(yes, no).sum() - 0.5 * (precision * (w - anchor) ** 2).sum())

    def slope_and_information(w: Array) -> tuple[Array, Array]:
        log_odds = rows @ w
        proba = expit(log_odds)
        slope = (expit(log_odds + evidence) - proba) @ rows - precision * (w - anchor)
        said = proba * right + (1 - proba) * (1 - right)
        # Fisher's information, which is never negative, in the place of the curvature.
        change = (2 * right - 1) * proba * (1 - proba)
        information = (rows.T * (change**2 / np.maximum(said * (1 - said), 1e-300))) @ rows
        return slope, information + np.diag(precision)

    w, reached = anchor, log_joint(anchor)
    for _ in range(MAX_ITER):
        slope, information = slope_and_information(w)
        step = np.linalg.solve(information, slope)
        if slope @ step < TOL:
            break
        size = 1.0
        while (now := log_joint(w + size * step)) < reached - TOL and size > TOL:
            size /= 2
        w, reached = w + size * step, now
    return w, np.linalg.inv(slope_and_information(w)[1])


@dataclass(frozen=True, eq=False)
class Witnesses:
    """Statements of W witnesses on M demonstrations."""

    evidence: Float[Array, "M W"]
    """Log-likelihood ratios of good against bad, nats; 0 where a witness says nothing."""
    confirmed: Float[Array, " W"]
    """The probability that the others confirm a witness, against chance."""
    sign: Float[Array, " W"]
    """1 where more is better, -1 where the others turn a witness."""

    @property
    def heard(self) -> tuple[int, ...]:
        """See `rpil.inference.answers.Answers`."""
        return tuple(np.where(self.confirmed > 0.5, self.sign, 0).astype(int).tolist())


def weigh(
    rows: Float[Array, "R D"],
    evidence: Float[Array, " R"],
    n_pairs: int,
    values: Float[Array, "M W"],
    settings: AnswerSettings,
) -> Witnesses:
    """Learn how reliable each of W witnesses is, whose `values` (NaN: unknown) are of the first M rows, beside the
    `evidence` of answers. More is thought to be better until the others say otherwise."""
    if not values.size:
        return Witnesses(values, np.ones(values.shape[1]), np.ones(values.shape[1]))
    n, levels = len(values), [levels_of(column, settings.max_levels) for column in values.T]
    priors, (alike, opposed) = [prior_counts(level, settings) for level in levels], most_alike(levels)
    n_same = [sum(np.array_equal(level, other) for other in levels) for level in levels]
    found = np.stack([log_ratio(counts)[level] for level, counts in zip(levels, priors, strict=True)], axis=1)
    # Whether what a witness says of other folds, as it is thought beforehand, predicts its levels.
    folds = (held_out(rows, evidence[:n] + said, settings) for said in found.T)
    gains = [reliability(*one)[1] for one in zip(folds, levels, priors, strict=True)]
    by_columns = expit(np.array(gains) - CHANCE) * ~opposed
    confirmed, sign = by_columns.copy(), np.ones(len(levels))
    for _ in range(MAX_ROUNDS):
        new = np.zeros_like(found)
        for k, (level, counts) in enumerate(zip(levels, priors, strict=True)):
            others = evidence.copy()
            ratio = log_ratio(counts) * (by_columns[k] > 0.5)  # nothing else may tell its worth
            others[:n] += found[:, ~alike[k]].sum(axis=1)
            if is_contrast(others, n_pairs):
                log_odds = regression(rows, others, n_pairs, settings, slice(n)) + others[:n]
                ratio, gain = reliability(log_odds, level, counts)
                by_others = float(expit(gain - len(ratio[:-1]) / 2 * np.log(max((level >= 0).sum(), 1))))
                sign[k] = np.sign(ratio[-2] - ratio[0]) or 1.0
                confirmed[k] = max(by_others, by_columns[k]) if sign[k] > 0 else by_others
            new[:, k] = confirmed[k] * ratio[level] / n_same[k]
        change, found = float(np.abs(new - found).max()), new
        if change < ENOUGH:
            break
    return Witnesses(found, confirmed, sign)


def levels_of(values: Float[Array, " M"], most: int) -> Int[Array, " M"]:
    """The place of each value among the different ones, or where these are more than `most`, among as many quantiles;
    -1 where it is unknown."""
    known, level = np.isfinite(values), np.full(len(values), -1)
    different, place = np.unique(values[known], return_inverse=True)
    if len(different) > most:
        place = ((mean_ranks(values[known]) - 0.5) * most / known.sum()).astype(int)
    level[known] = place
    return level


def prior_counts(level: Int[Array, " M"], settings: AnswerSettings) -> Float[Array, "2 K"]:
    """Levels of bad and of good demonstrations before anything is known of a witness, as counts."""
    shares = np.bincount(level[level >= 0], minlength=1) + 0.5
    tilt = settings.prior_log_odds / 2 * np.linspace(-0.5, 0.5, len(shares))
    counts = shares / shares.sum() * np.exp([-tilt, tilt])
    return np.asarray(settings.prior_counts * counts / counts.sum(axis=1, keepdims=True))


def log_ratio(counts: Float[Array, "2 K"]) -> Float[Array, " K+1"]:
    """log P(level | good) - log P(level | bad), and 0 for the level -1."""
    bad, good = np.log(counts / counts.sum(axis=1, keepdims=True))
    return np.append(good - bad, 0.0)


def most_alike(levels: list[Int[Array, " M"]]) -> tuple[Bool[Array, "W W"], Bool[Array, " W"]]:
    """Which witnesses are taken for each one: itself, the most correlated one, and all others from `TOO_ALIKE` on; and
    whether one of these is low where it is high, by more than chance. Correlations are those where both are known."""
    size, opposed = -np.eye(len(levels)), np.zeros((len(levels), len(levels)), dtype=bool)
    for i, j in permutations(range(len(levels)), 2):
        known = (levels[i] >= 0) & (levels[j] >= 0)
        one, other = levels[i][known], levels[j][known]
        if len({*one.tolist()}) > 1 and len({*other.tolist()}) > 1:
            correlation = np.corrcoef(one, other)[0, 1]
            size[i, j], opposed[i, j] = abs(correlation), correlation * np.sqrt(len(one)) < -2
    alike = size >= np.minimum(size.max(axis=1, keepdims=True), TOO_ALIKE)
    return alike | np.eye(len(levels), dtype=bool), (alike & opposed).any(axis=1)


def reliability(
    log_odds: Float[Array, " M"], level: Int[Array, " M"], prior: Float[Array, "2 K"], n_iter: int = 30
) -> tuple[Float[Array, " K+1"], float]:
    """The log-ratios of the levels of a witness, given the `log_odds` of good by all else, and the nats by which these
    explain its levels better than their shares do."""
    known, n = level >= 0, prior.shape[1]
    log_odds, level, counts = log_odds[known], level[known], prior
    for _ in range(n_iter):
        proba = expit(log_odds + log_ratio(counts)[level])
        counts = prior + np.stack([np.bincount(level, each, n) for each in (1 - proba, proba)])
    bad, good = counts / counts.sum(axis=1, keepdims=True)
    explained = expit(log_odds) * good[level] + expit(-log_odds) * bad[level]
    shares = np.bincount(level, minlength=n) + 0.5
    return log_ratio(counts), float(np.log(explained / (shares / shares.sum())[level]).sum())
