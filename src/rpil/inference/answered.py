"""What answers make of demonstrations: P(good), words, which answer contradicts the others, and what to ask next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit, xlogy

from rpil.inference.answers import Answers, posterior
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
    count: int
    """The number of answers about different demonstrations."""


def columns_of(
    channels: Float[Array, "M C"], log_odds: Float[Array, " M"], settings: AnswerSettings
) -> Float[Array, "M D"]:
    """The columns from which answers learn: normal scores of the channels, and the log-odds of the upper group."""
    bound = settings.max_group_log_odds
    return np.column_stack([normal_scores(channels), np.clip(log_odds, -bound, bound) / bound])


def answer(
    columns: Float[Array, "M D"], answers: Answers, settings: AnswerSettings, copy_of: Int[Array, " M"]
) -> Answered:
    """P(good) of every demonstration, by its `columns_of`; `copy_of` is the first of the copies of each.

    A copy confirms nothing: copies are judged as one demonstration, by what is known of any of them.
    """
    _, first, place = np.unique(copy_of, return_index=True, return_inverse=True)
    found = answer_about_different(columns[first], answers.once(copy_of), settings)
    named = np.flatnonzero(np.isin(place, found.contradicting) & (answers.labels != 0))
    return Answered(found.log_odds[place], found.words[place], named, found.count)


def answer_about_different(columns: Float[Array, "M D"], answers: Answers, settings: AnswerSettings) -> Answered:
    """P(good) of every demonstration where none is a copy of another.

    A label says what its own demonstration is; that it contradicts other answers is named beside it. A known outcome
    says P(good): the share of outcomes that are lower. About other demonstrations one answer alone gives no word.
    """
    found = posterior(columns, answers, settings)
    proba = np.clip(found.proba(columns), settings.min_proba_bound, 1 - settings.min_proba_bound)
    ranks, labels = answers.ranks(), answers.labels
    graded = np.isfinite(ranks) & (labels == 0)
    proba[graded] = np.clip(ranks[graded], settings.error_rates[0], 1 - settings.error_rates[0])
    result, alone, labelled = logit(proba), np.zeros(len(labels)), np.flatnonzero(labels)
    words = (result >= settings.log_odds).astype(int) - (result <= -settings.log_odds).astype(int)
    if answers.count < 2:
        words[:] = 0
    words[labelled] = labels[labelled]
    result[labelled] = labels[labelled] * logit(1 - settings.min_proba_bound)
    if 1 < answers.count <= settings.max_left_out:
        for m in labelled.tolist():
            others = posterior(columns, answers.without(m), settings)
            alone[m] = logit(others.proba(columns[m : m + 1])[0])
    return Answered(result, words, contradicting(alone, answers, settings), answers.count)


def contradicting(alone: Float[Array, " M"], answers: Answers, settings: AnswerSettings) -> Int[Array, " K"]:
    """The demonstrations whose labels the other answers make improbable, by their log-odds `alone`, without the label.

    A wrong label makes right ones improbable, too: only the most improbable are named, as many as leave each
    `min_other_answers` answers that it contradicts.
    """
    if answers.count > settings.max_left_out:
        return np.empty(0, dtype=int)
    labelled = np.flatnonzero(answers.labels)
    proba = expit(answers.labels * alone)
    most = answers.count // (settings.min_other_answers + 1)
    least = labelled[np.argsort(proba[labelled], kind="stable")][:most]
    return np.sort(least[proba[least] < settings.max_contradicted_proba])


def most_telling(
    columns: Float[Array, "M D"], answers: Answers, settings: AnswerSettings, k: int, excluded: Sequence[int] = ()
) -> list[int]:
    """Up to `k` demonstrations without a label whose labels would settle most, the best first.

    Each has the largest mutual information of its label and the weights (`information`, Houlsby et al. 2011), given
    that those before it are labelled.
    """
    found = posterior(columns, answers, settings)
    design = np.column_stack([np.ones(len(columns)), columns])
    mean, covariance, weight = design @ found.mean.T, found.covariance, np.exp(found.log_weight)
    unlabelled = answers.labels == 0
    unlabelled[list(excluded)] = False
    chosen: list[int] = []
    for _ in range(min(k, int(unlabelled.sum()))):
        variance = np.einsum("md,kde,me->mk", design, covariance, design)
        best = int(np.argmax(np.where(unlabelled, information(mean, variance, weight, settings), -np.inf)))
        chosen.append(best)
        unlabelled[best] = False
        proba = expit(mean[best])
        fisher = proba * (1 - proba)
        moved = covariance @ design[best]
        shrunk = fisher / (1 + fisher * variance[best])
        covariance = covariance - shrunk[:, None, None] * moved[:, :, None] * moved[:, None, :]
    return chosen


def information(
    mean: Float[Array, "M K"], variance: Float[Array, "M K"], weight: Float[Array, " K"], settings: AnswerSettings
) -> Float[Array, " M"]:
    """H(E p) - E H(p) of the label of each demonstration, in nats: p is the sigmoid of a mixture of K normal logits."""
    nodes, node_weight = np.polynomial.hermite_e.hermegauss(settings.n_nodes)
    proba = expit(mean[..., None] + np.sqrt(np.maximum(variance, 0.0))[..., None] * nodes)
    joint = weight[:, None] * (node_weight / node_weight.sum())
    expected = (proba * joint).sum(axis=(1, 2))
    return np.asarray(_entropy(expected) - (_entropy(proba) * joint).sum(axis=(1, 2)))


def _entropy(proba: Array) -> Array:
    """Entropy of a label with this probability, in nats."""
    return np.asarray(-xlogy(proba, proba) - xlogy(1 - proba, 1 - proba))
