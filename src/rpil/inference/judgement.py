"""The judge: held-out scores of concentrated policies, groups of scores, rivals, labels, demonstrators."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import expit

from rpil.data.fit_data import FitData
from rpil.inference.effective_steps import autocovariances, effective_steps
from rpil.inference.fitted_judge import FittedJudge, mean_variance
from rpil.inference.groups import SURE, UNSURE, Groups, fit_groups, share_interval
from rpil.inference.held_out import Scorer, frequencies, reference
from rpil.inference.rivals import Rival, find_rival, find_style
from rpil.inference.step_trust import StepTrust, step_trust
from rpil.inference.teachers import Taught, choose_ridge, concentrate, mean_steps, shares, taught_by
from rpil.mixture.demonstrator_prior import borrow, intervals
from rpil.numerics.regression import column_scales
from rpil.numerics.types import Array

FINDINGS = {
    "told apart": "The demonstrations fall into two groups; the one that agrees best is taken for the experts'.",
    "cannot be known": "Two groups of demonstrations each act alike, differently, in the same states: nothing says "
    "which of them is the expert.",
    "nobody stands out": "The scores are one group: demonstrations are ranked, none is accused.",
    "nothing could be learned": "The state says nothing of the actions that carries over to other demonstrations.",
}
"""What a judgement may come to, in a sentence."""

MINORITY = ("ask", "trust", "distrust")

SIGNIFICANT = 2.0
"""Standard errors by which looking at the state must predict held-out actions better than not looking."""

CERTAIN = 20.0
"""Log Bayes factor of two groups that are known to be there."""

LARGER = 3
"""Times that a trusted group may be larger than its rival for one labelled adversary in it to speak against it."""


@dataclass(frozen=True)
class Settings:
    """What the judge is told.

    Attributes
    ----------
    seed : int
        Of the folds.
    minority : {"ask", "trust", "distrust"}
        What to think of a group that acts alike and otherwise than the rest, where no label says.
    """

    seed: int = 0
    minority: str = "ask"


@dataclass(frozen=True, eq=False)
class Scores:
    """What was measured of M demonstrations.

    Attributes
    ----------
    score, variance : (M,) arrays
        Mean held-out measure of a demonstration's steps, nats, and the variance of that mean.
    effective : (M,) array
        Independent steps that each demonstration is worth.
    groups : Groups
    pooled : float
        Variance of a step's measure within a demonstration.
    learned : bool
        Whether looking at the state predicts held-out actions better than not looking.
    ridge : float
        A step, with which the policies were fitted.
    history : (T,) array
        Mean held-out log-likelihood of a step of the teachers, each round.
    """

    score: Array
    variance: Array
    effective: Array
    groups: Groups
    pooled: float
    learned: bool
    ridge: float
    history: Array


@dataclass(frozen=True, eq=False)
class Judgement:
    """What is said of M demonstrations.

    Attributes
    ----------
    finding : str
        One of `FINDINGS`.
    actions, demonstrator : (M,) arrays
        Log-odds of expert against adversary, nats: what a demonstration's own actions say, and what the others of its
        demonstrator add.
    scores : Scores
    log_ratio : (N,) array
        Held-out log pi - log q of every step; empty where steps are not kept.
    steps : StepTrust
    share : (mean, low, high)
        Of experts.
    rival : Rival or None
        The group that acts otherwise than the trusted one, where no label or option says what to think of it.
    teachers : (M,) bool array
        Who taught the last policies.
    people : (U, 3) array
        P(expert) of what each demonstrator gives: mean and 95 % interval.
    """

    finding: str
    actions: Array
    demonstrator: Array
    scores: Scores
    log_ratio: Array
    steps: StepTrust
    share: tuple[float, float, float]
    rival: Rival | None
    teachers: Array
    people: Array

    @property
    def log_odds(self) -> Array:
        """Of expert against adversary, (M,)."""
        return self.actions + self.demonstrator

    @property
    def groups(self) -> Groups:
        """One group of scores or two."""
        return self.scores.groups

    def keep(self, data: FitData, scale: Any) -> FittedJudge:
        """What is needed to judge other demonstrations, with `scale` the class of `rpil.inference.fitted_judge.SCALES`,
        or None where a policy of the user's measures."""
        weight = data.per_step(self.teachers.astype(float))
        measured = None if scale is None else scale.fit(data, weight, self.scores.ridge)
        independent = float(self.scores.effective.sum() / data.lengths.sum())
        of = frequencies(data) if data.space.kind == "discrete" else column_scales(data.actions)
        return FittedJudge(measured, self.groups, self.scores.pooled, independent, None if measured else of)


def judge(
    data: FitData,
    scorer: Scorer,
    settings: Settings,
    progress: Callable[[str], None] = lambda _: None,
) -> Judgement:
    """Judge the demonstrations of a problem by held-out policies of a `scorer`."""
    possible = data.labels >= 0
    q = reference(data, np.ones(data.n_demonstrations, dtype=bool))
    progress("ridge")
    ridge = choose_ridge(data, scorer, possible)
    gain = mean_steps(data, scorer.held_out(data.per_step(possible.astype(float)), ridge).log_prob - q)
    learned = bool(gain.mean() > SIGNIFICANT * gain.std() / np.sqrt(len(gain)))
    progress("policies of the best explained")
    taught, scores = _tell_apart(data, scorer, possible, ridge, q, learned)
    progress("rivals")
    apart, upper = scores.groups.p_two >= SURE, _upper(scores)
    if apart:
        rival = find_rival(data, scorer, upper & possible, ridge, settings.seed)
    else:
        rival = find_style(data, scorer, ridge, settings.seed)
    minority, decided, choice = settings.minority, None, 0
    if rival is not None and all((data.labels[group] > 0).any() for group in (rival.trusted, rival.rival)):
        minority = "trust"  # either group has a known expert
    labelled = (data.labels < 0).any() if minority == "trust" else data.labels.any()
    if rival is not None and (labelled or minority == "distrust"):
        if apart:
            other = taught_by(data, scorer, rival.rival, ridge)
            scores_other = measured(data, other, q, learned)
            choice = _choose(data, scores, scores_other, rival)
            taught, scores = (other, scores_other) if choice < 0 else (taught, scores)
        else:
            decided = _between_styles(data, taught, rival, learned)
            rival = None  # decided, or a label was given: it is not asked for again
    if choice:
        scores, rival = known(scores), None
    elif apart and minority != "trust" and _contradicted(data, scores):
        rival = Rival(np.flatnonzero(upper), np.flatnonzero(~upper), np.empty(0))
    log_ratio = taught.scored.log_prob - q
    steps = step_trust(data, log_ratio, np.minimum(scores.effective / data.lengths, 1.0))
    return conclude(data, scores, steps, log_ratio, taught.teachers, rival, minority, decided)


def _tell_apart(
    data: FitData, scorer: Scorer, possible: Array, ridge: float, q: Array, learned: bool
) -> tuple[Taught, Scores]:
    """Concentrate on ever fewer demonstrations until the scores show two groups; if they never do, the first scores.

    A smaller share helps only where adversaries were among those that taught before. So an upper group that is larger
    than that is no expert's: it is the crowd, with a few demonstrations below it. An upper group that is smaller than
    what teaches takes its place once, as in reweighted least squares (Rousseeuw and Leroy 1987).
    """
    found, before = [], possible
    for share in shares(data.n_demonstrations):
        taught = concentrate(data, scorer, before, ridge, share)
        scores = measured(data, taught, q, learned)
        upper = (_upper(scores) & possible) | (data.labels > 0)
        if scores.groups.p_two >= SURE and upper.sum() <= before.sum():
            if 2 <= upper.sum() < taught.teachers.sum():
                pure = taught_by(data, scorer, np.flatnonzero(upper), ridge)
                rescored = measured(data, pure, q, learned)
                if rescored.groups.p_two >= SURE:
                    return pure, rescored
            return taught, scores
        found.append((taught, scores))
        before = taught.teachers
    return found[0]


def _upper(scores: Scores) -> Array:
    """Which demonstrations are rather in the upper group, (M,) bool."""
    return np.asarray(scores.groups.log_odds(scores.score, scores.variance) > 0)


def measured(data: FitData, taught: Taught, q: Array, learned: bool) -> Scores:
    """Scores of all demonstrations under concentrated policies, their variances, and their groups.

    A probability is compared with how often its action is taken, log q (N,); a density with the box of the actions,
    which is the same for all of them.
    """
    worth = taught.scored.log_prob - (q if data.space.kind == "discrete" else 0.0)
    score = mean_steps(data, worth)
    squares = data.sum_steps((worth - data.per_step(score)) ** 2)
    pooled = float(squares.sum()) / max(len(worth) - data.n_demonstrations, 1)
    teach = data.select(np.flatnonzero(taught.teachers))
    residual = taught.scored.residual[data.per_step(taught.teachers)]
    effective = effective_steps(autocovariances(residual - residual.mean(), teach.offsets), data.lengths)
    variance = mean_variance(squares, data.lengths, pooled, effective)
    groups = fit_groups(score, variance, data.labels, effective, data.lengths)
    return Scores(score, variance, effective, groups, pooled, learned, taught.ridge, taught.history)


def _choose(data: FitData, scores: Scores, scores_other: Scores, rival: Rival) -> int:
    """Which of two groups is the expert: 1 the trusted, -1 the rival, 0 if nothing says; by labels, else by size.

    A labelled expert decides. A labelled adversary among many trusted demonstrations may be one that was not noticed.
    """
    if not data.labels.any():
        return 1 if len(rival.trusted) >= len(rival.rival) else -1
    against, against_other = (
        int((data.labels * of.groups.log_odds(of.score, of.variance) < 0).sum()) for of in (scores, scores_other)
    )
    said = data.labels @ data.sum_steps(rival.log_ratio)
    if against < against_other or (against == against_other and said > 0):
        return 1
    changed = against_other < against or (against == against_other and said < 0)
    return -1 if changed and _may_change(data, rival) else 0


def _may_change(data: FitData, rival: Rival) -> bool:
    """Whether labels may speak for the rival group: one of an expert, or the groups are of comparable size."""
    return bool((data.labels > 0).any()) or LARGER * len(rival.rival) >= len(rival.trusted)


def _between_styles(data: FitData, taught: Taught, rival: Rival, learned: bool) -> Array | None:
    """Log-odds of demonstrations, (M,), where labels, or else the size, say which of two styles is the expert's: from
    how much better its policy explains them than the other's. None where labels do not say, or scores show one group.

    Where the two are not opposed, labels of one sort rank them and accuse nobody: the other may be as good, or as bad.
    """
    labels = data.labels
    said = labels @ data.sum_steps(rival.log_ratio) if labels.any() else 1.0
    contrast = replace(taught, scored=replace(taught.scored, log_prob=np.sign(said) * rival.log_ratio))
    scores = measured(data, contrast, np.zeros(len(rival.log_ratio)), learned)
    unclear = scores.groups.p_two < SURE and not rival.opposed
    if labels.any() and (unclear or said == 0 or (said < 0 and not _may_change(data, rival))):
        return None
    settled = rival.opposed or not labels.any() or labels.min() < 0 < labels.max()
    log_odds = known(scores).groups.log_odds(scores.score, scores.variance)
    return log_odds if settled else UNSURE * np.tanh(log_odds / UNSURE)


def known(scores: Scores) -> Scores:
    """`scores` where it is known that there are two groups."""
    certain = max(scores.groups.log_bayes_factor, CERTAIN)
    return replace(scores, groups=replace(scores.groups, log_bayes_factor=certain))


def _contradicted(data: FitData, scores: Scores) -> bool:
    """Whether at least half of the labels, one of an expert or two, speak against the scores: then the groups may have
    changed places."""
    log_odds = scores.groups.log_odds(scores.score, scores.variance)
    against = data.labels * log_odds < 0
    expert = bool((against & (data.labels > 0)).any())
    return 2 * against.sum() >= (data.labels != 0).sum() and (expert or against.sum() >= 2)


def conclude(
    data: FitData,
    scores: Scores,
    steps: StepTrust,
    log_ratio: Array,
    teachers: Array,
    rival: Rival | None,
    minority: str,
    decided: Array | None = None,
) -> Judgement:
    """What `scores` and a `rival` group come to, under `minority` as in `Settings`; `decided` (M,) are the log-odds
    where a label, or the user, says which of two styles is the expert's."""
    groups = scores.groups
    actions = groups.log_odds(scores.score, scores.variance)
    if rival is not None and minority == "trust":
        actions[rival.rival] = np.maximum(actions[rival.rival], np.median(actions[rival.trusted]))
    actions = groups.bounded(actions) if decided is None else decided
    apart = groups.p_two >= SURE or bool((np.abs(actions) >= UNSURE).any())
    demonstrator, people = np.zeros(len(actions)), np.empty((0, 3))
    if data.demonstrators.informative:
        lent = borrow(data.demonstrators, actions, np.zeros(len(actions)), data.labels)
        demonstrator, people = lent.log_odds, intervals(lent.share, lent.weight)
    if rival is not None and rival.opposed and minority == "ask":
        finding = "cannot be known"
    elif apart or (np.abs(actions + demonstrator) >= UNSURE).any():  # the latter by demonstrators
        finding = "told apart"
    else:
        finding = "nobody stands out" if scores.learned else "nothing could be learned"
    return Judgement(
        finding=finding,
        actions=actions,
        demonstrator=demonstrator,
        scores=scores,
        log_ratio=log_ratio,
        steps=steps,
        share=share_interval(expit(actions + demonstrator), 1.0 if apart else groups.p_two),
        rival=rival if finding != "told apart" and minority == "ask" else None,
        teachers=teachers,
        people=people,
    )
