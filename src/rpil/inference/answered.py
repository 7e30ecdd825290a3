"""What answers make of demonstrations: P(good), verdicts, which answer contradicts the others, and what to ask next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logit

from rpil.inference.answers import Answers, explained, posterior, predicted
from rpil.inference.settings import AnswerSettings
from rpil.numerics.types import Array, Bool, Float, Int

GOLDEN = 0.618
"""Places of further questions are spread by multiples of it."""


@dataclass(frozen=True, eq=False)
class Answered:
    """What answers say of M demonstrations."""

    log_odds: Float[Array, " M"]
    """Of good against bad, nats."""
    verdicts: Int[Array, " M"]
    """1 good, 0 neither, -1 bad."""
    contradicting: Int[Array, " K"]
    """Demonstrations whose label contradicts the other answers."""
    count: int
    """The number of answers about different demonstrations."""
    follows: bool
    """Whether the answers predict each other."""


def answer(
    columns: Float[Array, "M C"], answers: Answers, settings: AnswerSettings, copy_of: Int[Array, " M"]
) -> Answered:
    """P(good) of every demonstration, by its `columns`; `copy_of` is the first of the copies of each.

    Each has the verdict of its label, or is bad where a flag says so; labels that other answers contradict are named.
    Others have a verdict once answers contrast and predict each other. Copies are judged as one demonstration, by what
    is known of any of them.
    """
    _, first, place = np.unique(copy_of, return_index=True, return_inverse=True)
    columns, once = columns[first], answers.once(copy_of)
    outcome = np.where(once.labels == 0, once.ranks(), np.nan)
    proba = posterior(columns, once, settings).proba(np.column_stack([np.ones(len(columns)), columns]), outcome)
    log_odds = logit(np.clip(proba, settings.min_proba_bound, 1 - settings.min_proba_bound))
    targets, by_others, share = predicted(columns, once, settings)
    follows = once.contrast and explained(targets, by_others, share) >= settings.min_explained
    limit = logit(settings.min_proba) if follows else np.inf
    verdicts = (log_odds >= limit).astype(int) - (log_odds <= -limit)
    said = answers.shared(copy_of).said
    log_odds = np.where(said == 0, log_odds[place], said * logit(1 - settings.min_proba_bound))
    verdicts = np.where(said == 0, verdicts[place], said)
    doubtful = contradicting(once, np.abs(1 - targets - by_others), settings)
    named = np.flatnonzero(np.isin(place, doubtful) & (answers.labels != 0))
    return Answered(log_odds, verdicts, named, once.count, bool(follows))


def contradicting(answers: Answers, expected: Float[Array, " R"], settings: AnswerSettings) -> Int[Array, " K"]:
    """The demonstrations whose labels the other answers make improbable; labels are the first of the R answers, and
    the others expect each with the probability `expected`.

    Without a contrast none does. A wrong label makes right ones improbable, too: only the most improbable are named, as
    many as leave each `min_other_answers` answers that it contradicts.
    """
    labelled = np.flatnonzero(answers.labels)
    most = answers.count // (settings.min_other_answers + 1) if answers.contrast else 0
    expected = expected[: len(labelled)]
    least = np.argsort(expected, kind="stable")[:most]
    return np.sort(labelled[least[expected[least] < settings.max_contradicted_proba]])


def places_to_ask(
    log_odds: Float[Array, " M"], is_said: Bool[Array, " M"], n_answers: int, settings: AnswerSettings, k: int
) -> list[int]:
    """Up to `k` demonstrations to ask about, of which nothing `is_said`, the first one first: those nearest to fixed
    places of the ranking by `log_odds`, from either end in turn, of which `n_answers` have been asked already."""
    place = np.argsort(np.argsort(log_odds, kind="stable")) / max(len(log_odds) - 1, 1)
    free, chosen = ~is_said, list[int]()
    for n in range(n_answers, n_answers + min(k, int(free.sum()))):
        asked = settings.asked_places[n] if n < len(settings.asked_places) else n * GOLDEN % 1
        chosen.append(int(np.argmin(np.where(free, np.abs(place - asked), np.inf))))
        free[chosen[-1]] = False
    return chosen
