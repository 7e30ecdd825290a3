"""What answers make of demonstrations: P(good), verdicts, which answer contradicts the others, and what to ask next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logit

from rpil.inference.answers import Answers, posterior
from rpil.inference.channels import normal_scores
from rpil.inference.settings import AnswerSettings
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Answered:
    """What answers say of M demonstrations."""

    log_odds: Float[Array, " M"]
    """Of good against bad, nats."""
    verdicts: Int[Array, " M"]
    """1 good, 0 neither, -1 bad."""
    stays: Int[Array, " M"]
    """Where they give no verdict and do not contradict what was said without them: 1 similar, -1 outlier; else 0."""
    contradicting: Int[Array, " K"]
    """Demonstrations whose label contradicts the other answers."""
    count: int
    """The number of answers about different demonstrations."""
    p_nothing: float
    """Probability that they follow nothing of what is known of the demonstrations."""


def columns_of(
    channels: Float[Array, "M C"],
    components: Float[Array, "M K"],
    log_odds: Float[Array, " M"],
    settings: AnswerSettings,
) -> Float[Array, "M D"]:
    """The columns from which answers learn: normal scores of channels, components, log-odds of the upper group."""
    bound = settings.max_group_log_odds
    return np.column_stack([normal_scores(channels), components, np.clip(log_odds, -bound, bound) / bound])


def learned_from(
    columns: Float[Array, "M D"], within: Float[Array, "M W"], answers: Answers, settings: AnswerSettings
) -> Float[Array, "M _"]:
    """The columns from which these answers learn: those `within` two groups, where labels call members of both good, or
    members of both bad, and all answers together, were they right, have more evidence by them."""
    if not within.shape[1]:
        return columns
    is_upper = within[:, -2] > 0
    alike = (
        (answers.labels[is_upper] == label).any() & (answers.labels[~is_upper] == label).any() for label in (1, -1)
    )
    if not any(alike):
        return columns
    right = replace(settings, error_rates=settings.error_rates[:1])
    return max(columns, within, key=lambda one: posterior(one, answers, right).log_evidence)


def answer(
    columns: Float[Array, "M D"],
    answers: Answers,
    settings: AnswerSettings,
    copy_of: Int[Array, " M"],
    claimed: Int[Array, " M"],
) -> Answered:
    """P(good) of every demonstration, by its `columns_of`; `copy_of` is the first of the copies of each, and `claimed`
    is what was said without answers: 1 similar, 0 open, -1 outlier.

    Each has the verdict of its label, or is bad where a flag says so; labels that other answers contradict are named.
    No other one is good before an answer calls one good, or bad before one is called bad, and one answer alone changes
    no verdict. Copies are judged as one demonstration, by what is known of any of them.
    """
    _, first, place = np.unique(copy_of, return_index=True, return_inverse=True)
    columns, claimed, once = columns[first], claimed[first], answers.once(copy_of)
    fitted, labels = posterior(columns, once, settings), once.labels
    proba = fitted.proba(columns, np.where(labels == 0, once.ranks(), np.nan))
    log_odds = logit(np.clip(proba, settings.min_proba_bound, 1 - settings.min_proba_bound))
    if once.count < 2:
        verdicts, stays = np.zeros(len(columns), dtype=int), claimed
    else:
        good = (log_odds >= logit(settings.min_proba)) & (1 in once.sides)
        bad = (log_odds <= -logit(settings.min_proba)) & (-1 in once.sides)
        verdicts, stays = good.astype(int) - bad.astype(int), np.where(claimed * log_odds >= 0, claimed, 0)
    said = answers.shared(copy_of).said
    log_odds = np.where(said == 0, log_odds[place], said * logit(1 - settings.min_proba_bound))
    verdicts = np.where(said == 0, verdicts[place], said)
    stays, doubtful = np.where(verdicts == 0, stays[place], 0), contradicting(columns, once, settings)
    named = np.flatnonzero(np.isin(place, doubtful) & (answers.labels != 0))
    return Answered(log_odds, verdicts, stays, named, once.count, fitted.p_nothing)


def contradicting(columns: Float[Array, "M D"], answers: Answers, settings: AnswerSettings) -> Int[Array, " K"]:
    """The demonstrations whose labels the other answers make improbable.

    A wrong label makes right ones improbable, too: only the most improbable are named, as many as leave each
    `min_other_answers` answers that it contradicts.
    """
    labelled, most = np.flatnonzero(answers.labels), answers.count // (settings.min_other_answers + 1)
    if not most or answers.count > settings.max_left_out:
        return labelled[:0]
    rows, targets = answers.rows(columns)
    expected = np.empty(len(labelled))
    for r in range(len(labelled)):
        others = posterior(columns, answers.only(np.arange(answers.count) != r), settings)
        expected[r] = np.abs(1 - targets[r] - others.proba_of(rows[r : r + 1])[0])
    least = np.argsort(expected, kind="stable")[:most]
    return np.sort(labelled[least[expected[least] < settings.max_contradicted_proba]])


def most_telling(
    columns: Float[Array, "M D"], answers: Answers, settings: AnswerSettings, k: int, excluded: Sequence[int] = ()
) -> list[int]:
    """Up to `k` demonstrations to ask about, of which nothing was said, the first one first: those nearest to
    `asked_quantiles` of the ranking by P(good), of which the last one is that of all further ones."""
    proba = posterior(columns, answers, settings).proba(columns)
    place = np.argsort(np.argsort(proba, kind="stable")) / max(len(columns) - 1, 1)
    asked = answers.said == 0
    asked[list(excluded)] = False
    first, chosen = int(np.count_nonzero(answers.labels)), list[int]()
    for n in range(first, first + min(k, int(asked.sum()))):
        quantile = settings.asked_quantiles[min(n, len(settings.asked_quantiles) - 1)]
        chosen.append(int(np.argmin(np.where(asked, np.abs(place - quantile), np.inf))))
        asked[chosen[-1]] = False
    return chosen
