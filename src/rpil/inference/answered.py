"""What answers make of demonstrations: P(good), words, which answer contradicts the others, and what to ask next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit

from rpil.inference.answers import Answers, Posterior, posterior
from rpil.inference.channels import normal_scores
from rpil.inference.settings import AnswerSettings
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Answered:
    """What answers say of M demonstrations."""

    log_odds: Float[Array, " M"]
    """Of good against bad, nats."""
    words: Int[Array, " M"]
    """1 good, 0 open, -1 bad."""
    contradicting: Int[Array, " K"]
    """Demonstrations whose label contradicts the other answers."""
    error_rate: float
    """Posterior mean of the rate of wrong answers."""


def columns_of(
    channels: Float[Array, "M C"], log_odds: Float[Array, " M"], settings: AnswerSettings
) -> Float[Array, "M D"]:
    """The columns from which answers learn: normal scores of the channels, and the log-odds of the upper group."""
    bound = settings.max_group_log_odds
    return np.column_stack([normal_scores(channels), np.clip(log_odds, -bound, bound) / bound])


def answer(columns: Float[Array, "M D"], answers: Answers, settings: AnswerSettings) -> Answered:
    """P(good) of every demonstration, by its `columns_of`.

    A label is itself an answer that may be wrong: its demonstration is judged by the other answers and by it. A known
    outcome says P(good): the share of outcomes that are lower. One answer alone gives no word.
    """
    found = posterior(columns, answers, settings)
    proba = np.clip(found.proba(columns), settings.min_proba_bound, 1 - settings.min_proba_bound)
    ranks = answers.ranks()
    graded = np.isfinite(ranks) & (answers.labels == 0)
    proba[graded] = np.clip(ranks[graded], settings.error_rates[0], 1 - settings.error_rates[0])
    result, labels = logit(proba), answers.labels
    contradicting = []
    sure = logit(1 - settings.error_rates[0])
    for m in np.flatnonzero(labels).tolist():
        others = answers.without(m)
        alone = result[m]
        if others.any and answers.count <= settings.max_left_out:
            alone = float(logit(posterior(columns, others, settings).proba(columns[m : m + 1])[0]))
            disagrees = expit(labels[m] * alone) < settings.max_contradicted_proba
            if disagrees and others.count >= settings.min_other_answers:
                contradicting.append(m)
        result[m] = alone + labels[m] * (0.0 if m in contradicting else max(sure, abs(alone)))
    words = (result >= settings.log_odds).astype(int) - (result <= -settings.log_odds).astype(int)
    if answers.count < 2:
        words[:] = 0
    return Answered(result, words, np.array(contradicting, dtype=int), found.error_rate)


def most_telling(
    columns: Float[Array, "M D"], answers: Answers, settings: AnswerSettings, k: int, excluded: Sequence[int] = ()
) -> list[int]:
    """Up to `k` demonstrations without an answer whose labels would settle most, the best first.

    Each has the largest expected information about w, P(good) (1 - P(good)) Var(logit), given that those before it are
    answered (Bayesian D-optimal design, Chaloner and Verdinelli 1995).
    """
    found = posterior(columns, answers, settings)
    design = np.column_stack([np.ones(len(columns)), columns])
    covariance = _covariance(found)
    proba = found.proba(columns)
    information = proba * (1 - proba)
    open_ = answers.labels == 0
    open_[list(excluded)] = False
    chosen: list[int] = []
    for _ in range(min(k, int(open_.sum()))):
        variance = np.einsum("md,de,me->m", design, covariance, design)
        best = int(np.argmax(np.where(open_, variance * information, -np.inf)))
        chosen.append(best)
        open_[best] = False
        moved = covariance @ design[best]
        covariance = covariance - np.outer(moved, moved) * information[best] / (1 + variance[best] * information[best])
    return chosen


def _covariance(found: Posterior) -> Array:
    """Covariance of w over all directions and rates of wrong answers."""
    weight = np.exp(found.log_weight)
    mean = weight @ found.mean
    away = found.mean - mean
    return np.asarray(np.einsum("k,kde->de", weight, found.covariance) + (weight[:, None] * away).T @ away)
