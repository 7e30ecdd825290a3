"""Learn from answers: P(good), verdicts, which answer contradicts the others, and what to ask next.

P(good) is that of a logistic regression on the columns of `rpil.inference.channels`, and of witnesses
(`rpil.inference.witnesses`). w_0 says that those that agree are good: it is `by_ranking` on the first column, the
ranking, and `by_group` on the last one, the group of scores. "i is better than j" is a row x_i - x_j, and "no
difference" such a row both ways (Davidson 1970). Demonstrators are columns, too, which count as far as answers bear
them out.

Answers act as far as they predict each other: the trust in them is how much more often than not the others are right
about each. Each of several tasks has weights of its own beside those that all share. docs/model.md has the formulas.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.constants import golden
from scipy.special import expit, log_expit, logit

from rpil.data.fit_data import Demonstrators
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS
from rpil.inference.settings import AnswerSettings
from rpil.inference.witnesses import Witnesses, is_contrast, regression, weigh
from rpil.numerics.regression import mean_ranks
from rpil.numerics.types import Array, Bool, Float, Int

NOBODY = Demonstrators()
MOST_INDICATORS = 30
"""Demonstrators with a column of their own at most, those with most answers: the time of a fit grows with the cube."""
MOST_TASKS = 4
"""Tasks with weights of their own at most, those with most answers; all others share such weights."""


@dataclass(frozen=True, eq=False)
class Answered:
    """Result of the answers about M demonstrations."""

    log_odds: Float[Array, " M"]
    """Log-odds of good against bad, nats."""
    verdicts: Int[Array, " M"]
    """1 good, 0 neither, -1 bad."""
    contradicting: Int[Array, " K"]
    """Demonstrations whose label contradicts the other answers."""
    count: int
    """The number of answers about different demonstrations."""
    follows: bool
    """Whether the answers predict each other."""
    witnesses: Witnesses
    """Witnesses of the different demonstrations."""


def answer(
    columns: Float[Array, "M C"],
    answers: Answers,
    settings: AnswerSettings,
    copy_of: Int[Array, " M"],
    who: Demonstrators = NOBODY,
    task_of: Int[Array, " M"] | None = None,
) -> Answered:
    """P(good) of every demonstration, by its `columns` and by `who` gave it; `copy_of` is the first of its copies, and
    `task_of` the number of its task, or -1 for one that nobody judged.

    Each has the verdict of its label, or is bad if it `failed`; labels that other answers contradict are named. Others
    have a verdict once answers contrast and predict each other. Copies are judged as one, by what is known of any.
    """
    _, first, place = np.unique(copy_of, return_index=True, return_inverse=True)
    once, columns = answers.once(copy_of), columns[first]
    task = np.zeros(len(first), dtype=np.int64) if task_of is None else task_of[first]
    if task_of is not None:
        once = replace(once, outcomes=ranked_in_tasks(once.outcomes, task, once.only_flag))
        columns = with_tasks(columns, once, task)
    if who.informative:
        named = np.argsort([who.names[u] is None for u in who.index], kind="stable")  # of copies the first with a name
        index = who.index[named[np.unique(place[named], return_index=True)[1]]]
        columns = with_demonstrators(columns, once, index, settings.demonstrator_scale)
    rows, n_pairs = once.rows(columns)
    evidence, total = once.evidence(logit(1 - settings.error)), once.evidence(logit(1 - settings.error))
    witnesses = weigh(rows, evidence, n_pairs, once.outcomes, settings)
    once = replace(once, heard=witnesses.heard)
    by_witnesses = witnesses.evidence.sum(axis=1)
    total[: len(first)] += by_witnesses
    answered, right = predicted(rows, evidence, total, n_pairs, len(once.tied), settings)
    told = slice(len(answered) - 2 * len(once.tied))  # no difference is as right both ways
    trust = max(agreement(evidence[answered][told], right[told], len(once.pairs)), settings.min_trust)
    in_task: float | Array = trust
    if task_of is not None:
        of_rows = np.concatenate([task, task[once.pairs[:, 0]], task[once.tied.T.ravel()]])
        in_task = trust_in_tasks(trust, of_rows[answered][told], right[told], task, settings.min_trust)
    both, by_columns = is_contrast(evidence, n_pairs), regression(rows, total, n_pairs, settings, slice(len(first)))
    follows = once.contrast and (trust > settings.min_trust if both else any(witnesses.heard))
    share = np.minimum(in_task / settings.full_trust, 1.0) ** 2 if both else 1 / 2  # outcomes alone may err together
    factor = settings.sharpness * share if both or follows else 1.0
    log_odds = np.where(task < 0, 0.0, factor * by_columns) + by_witnesses
    limit = logit(settings.min_proba) if follows else np.inf
    verdicts = (log_odds >= limit).astype(int) - (log_odds <= -limit)
    known, log_odds = replace(answers, heard=witnesses.heard).shared(copy_of), log_odds[place]
    said = known.said(log_odds)
    verdicts = np.where(said == 0, verdicts[place], said)
    log_odds = np.where(said == 0, log_odds, log_expit(log_odds) - logit(1 - settings.error))  # failed, in their order
    sure = logit(1 - settings.min_proba_bound)
    log_odds = np.where(known.labels == 0, np.clip(log_odds, -sure, sure), known.labels * sure)
    doubtful = contradicting(once, right[: np.count_nonzero(once.labels)], settings)
    named = np.flatnonzero(np.isin(place, doubtful) & (answers.labels != 0))
    return Answered(log_odds, verdicts, named, once.count, bool(follows), witnesses)


def with_demonstrators(
    columns: Float[Array, "M C"], answers: Answers, index: Int[Array, " M"], scale: float
) -> Float[Array, "M D"]:
    """The `columns`, and before the last one those of the demonstrators with these numbers, times `scale`: the mean
    ranking of a demonstrator's other demonstrations, and an indicator of each demonstrator with two answered ones, of
    `MOST_INDICATORS` at most. So one answer says nothing of its demonstrator."""
    ranking = columns[:, 0] - columns[:, 0].mean()
    n_others = np.maximum(np.bincount(index)[index] - 1, 1)
    others = (np.bincount(index, ranking)[index] - ranking) / n_others
    answered = np.unique(np.concatenate([np.flatnonzero(answers.labels), answers.compared.ravel()]))
    counts = np.bincount(index[answered], minlength=1)
    most = np.argsort(-counts, kind="stable")[:MOST_INDICATORS]
    indicators = index[:, None] == np.sort(most[counts[most] > 1])
    return np.column_stack([columns[:, :-1], scale * others, scale * indicators, columns[:, -1]])


def with_tasks(columns: Float[Array, "M C"], answers: Answers, task: Int[Array, " M"]) -> Float[Array, "M D"]:
    """The channels, which all tasks share; all columns of each task with answers, which are 0 elsewhere, of
    `MOST_TASKS` at most; those of all others together, without components; and the group of scores."""
    answered = np.unique(np.concatenate([np.flatnonzero(answers.labels), answers.compared.ravel()]))
    counts = np.bincount(task[answered] + 1)  # from task -1 on
    most = np.argsort(-counts, kind="stable")[:MOST_TASKS]
    own = task[:, None] == most[counts[most] > 0] - 1
    shared, group = columns[:, : len(CHANNELS)], columns[:, -1:]
    others = np.hstack([shared, group]) * ~own.any(axis=1, keepdims=True)  # components of several are no column
    return np.hstack([shared, *(columns * rows[:, None] for rows in own.T), others, group])


def ranked_in_tasks(outcomes: Float[Array, "M W"], task: Int[Array, " M"], flag: int) -> Float[Array, "M W"]:
    """The outcomes; those of more than two values, but for the `flag` of copies, are ranks within each task, because
    tasks differ in length. They say nothing where all of a task are alike."""
    ranked = outcomes.copy()
    for k, values in enumerate(ranked.T):
        known = np.isfinite(values)
        for number in np.unique(task[known]) if k != flag and len(np.unique(values[known])) > 2 else ():
            own = np.flatnonzero(known & (task == number))
            values[own] = (mean_ranks(values[own]) - 0.5) / len(own) if np.ptp(values[own]) else np.nan
    return ranked


def trust_in_tasks(
    trust: float, of_answer: Int[Array, " A"], right: Float[Array, " A"], task: Int[Array, " M"], least: float
) -> Float[Array, " M"]:
    """The trust in the answers about the task of each demonstration: the mean of that in each, of the `trust` in
    answers of all tasks, and of 0, as if these were two more; `least` without an answer, and 0 in the task -1."""
    total, n = (np.bincount(of_answer + 1, weights, task.max() + 2) for weights in (2 * right - 1, None))
    own = np.where(n > 0, np.maximum((total + trust) / (n + 2), least), least)
    return np.asarray(np.where(task < 0, 0.0, own[task + 1]))


def predicted(
    rows: Float[Array, "R D"],
    evidence: Float[Array, " R"],
    total: Float[Array, " R"],
    n_pairs: int,
    n_tied: int,
    settings: AnswerSettings,
) -> tuple[Int[Array, " A"], Float[Array, " A"]]:
    """The rows of labels and pairs, of which the last are ties the other way, and the probability of each by all else;
    of many, by those of other folds."""
    answered = np.flatnonzero(evidence)
    fold, right = np.arange(len(answered)) % settings.max_folds, np.empty(len(answered))
    fold[len(fold) - n_tied :] = fold[len(fold) - 2 * n_tied :][:n_tied]
    for k in range(min(len(answered), settings.max_folds)):
        own = answered[fold == k]
        others = total.copy()
        others[own] -= evidence[own]
        log_odds = regression(rows, others, n_pairs, settings, own) + others[own]
        right[fold == k] = settings.error + (1 - 2 * settings.error) * expit(np.sign(evidence[own]) * log_odds)
    return answered, right


def agreement(evidence: Float[Array, " A"], right: Float[Array, " A"], n_pairs: int) -> float:
    """How much more often than not answers are `right` by the others, from -1 to 1: of those for good and of those for
    bad in equal parts, so that their share tells nothing; a pair is both, and the last `n_pairs` are pairs."""
    is_pair = np.arange(len(evidence)) >= len(evidence) - n_pairs
    sides = (right[is_pair | (evidence * sign > 0)] for sign in (1, -1))
    return float(np.mean([2 * side.mean() - 1 if len(side) else 0.0 for side in sides]))


def contradicting(answers: Answers, right: Float[Array, " L"], settings: AnswerSettings) -> Int[Array, " K"]:
    """The demonstrations whose labels the other answers make improbable; each label is `right` with a probability by
    the others.

    Without a contrast none does. A wrong label makes right ones improbable, too: only the most improbable are named, as
    many as leave each `min_other_answers` answers that it contradicts.
    """
    labelled = np.flatnonzero(answers.labels)
    most = answers.count // (settings.min_other_answers + 1) if answers.contrast else 0
    least = np.argsort(right, kind="stable")[:most]
    return np.sort(labelled[least[right[least] < settings.max_contradicted_proba]])


def places_to_ask(
    ranking: Float[Array, " M"],
    log_odds: Float[Array, " M"],
    labels: Int[Array, " M"],
    is_said: Bool[Array, " M"],
    settings: AnswerSettings,
    k: int,
) -> list[int]:
    """Up to `k` demonstrations to ask about, of which nothing `is_said`, the first one first: those nearest to fixed
    places of the ranking, from either end in turn; the `labels` have been asked for already. Where these are of both
    kinds, and one leads, the first is one that its `log_odds` of good call likely to be of the other kind."""
    place = np.argsort(np.argsort(ranking, kind="stable")) / max(len(ranking) - 1, 1)
    free, chosen, n_answers, lead = ~is_said, list[int](), int(np.count_nonzero(labels)), int(labels.sum())
    if settings.max_lead <= abs(lead) < n_answers and free.any():
        order = np.flatnonzero(free)[np.argsort(np.sign(lead) * log_odds[free], kind="stable")]
        chosen.append(int(order[int(settings.end_place * len(order))]))
        free[chosen] = False
    for n in range(n_answers + len(chosen), n_answers + min(k, len(chosen) + int(free.sum()))):
        asked = (settings.end_place, 1 - settings.end_place)[n] if n < 2 else n * golden % 1
        chosen.append(int(np.argmin(np.where(free, np.abs(place - asked), np.inf))))
        free[chosen[-1]] = False
    return chosen
