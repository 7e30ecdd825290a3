"""What the scores support without answers: which demonstrations act like most others, which differ,
and what speaks against it.

A demonstration is an `outlier` only if all of this holds, with two dealings of the folds:

    by groups     P(two groups of scores) >= min_p_two,  and P(upper group | m) <= 1 - min_proba
    or by chance  (discrete actions) it is explained worse than by the frequencies of the actions, as noise is,
                  and P(two groups) >= min_p_two_of_noise

and the policy of the upper group explains that group, the lower demonstrations have no policy of their own
(`rpil.inference.rivals`; else there are two groups), and no `Doubt` is left. The upper group is `similar`; only its
better half where the lower group is a tail and not a cluster of its own, because a tail seldom holds all that differ.
Nothing here says who is good.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logit, ndtr

from rpil.data.copies import Copies
from rpil.data.demonstrator_groups import Demonstrators
from rpil.inference.findings import Finding
from rpil.inference.rivals import Contrast, Lower, SecondWay, contrast, is_learnable, look_below
from rpil.inference.scores import Scores, Scoring
from rpil.inference.settings import ClaimSettings, JudgeSettings
from rpil.numerics.regression import mean_ranks
from rpil.numerics.types import Array, Bool, Float, Int

FEW_RUNS = (
    "Those with low scores follow one another in the order of recording ({members}): perhaps another session or "
    "set-up, and not necessarily worse."
)


@dataclass(frozen=True, eq=False)
class Doubt:
    """A reason not to call demonstrations outliers."""

    sentence: str
    """In it, {members} stands for the names of the demonstrations."""
    runs: tuple[Int[Array, " _"], ...] = ()
    """The demonstrations that the sentence names, in runs that follow one another in the stated order."""
    operators: tuple[Hashable, ...] = ()
    """The operators that the sentence names; {operators} stands for their names."""


@dataclass(frozen=True, eq=False)
class Claims:
    """What the scores of M demonstrations support."""

    finding: Finding
    verdicts: Int[Array, " M"]
    """1 similar, 0 open, -1 outlier."""
    doubts: tuple[Doubt, ...] = ()
    lower: Lower | None = None
    """The demonstrations below the upper group, where the scores are two groups."""
    contrast: Contrast | None = None
    """How two groups differ that each have a policy of their own."""
    do_steps_tell: bool = False
    """Whether steps are compared by policies of the training group and of the others
    (`rpil.inference.rivals.do_steps_tell`)."""

    @property
    def groups(self) -> tuple[Int[Array, " A"], Int[Array, " B"]] | None:
        """The members of two groups that each have a policy of their own."""
        if self.finding != "two groups" or self.lower is None:
            return None
        return self.lower.upper, self.lower.rival

    def repeated(self, copies: Copies) -> Claims:
        """The same about demonstrations of which these are the different ones; a doubt names one of each copies.
        Nothing where all are copies of one."""
        if copies.all_same:
            return Claims("nothing could be learned", np.zeros(len(copies.place), dtype=int))
        doubts = tuple(replace(doubt, runs=tuple(copies.first[run] for run in doubt.runs)) for doubt in self.doubts)
        lower = self.lower
        if lower is not None:
            upper, rival = (np.flatnonzero(np.isin(copies.place, group)) for group in (lower.upper, lower.rival))
            lower = replace(lower, upper=upper, rival=rival)
        return replace(self, verdicts=self.verdicts[copies.place], doubts=doubts, lower=lower)


def claim(scoring: Scoring, scores: Scores, again: Scores | None, order: Float[Array, " M"] | None) -> Claims:
    """The claims that `scores` support.

    Parameters
    ----------
    again : Scores or None
        With other folds.
    order : (M,) array or None
        The order in which the demonstrations were made, where it is stated.
    """
    data = scoring.data
    nobody = np.zeros(data.n_demonstrations, dtype=int)
    groups, chance = by_groups(scoring, scores, again), by_chance(scoring, scores, again)
    split = chance if groups is None or (chance is not None and not groups.with_other_folds) else groups
    if split is None:
        return Claims("no outliers" if scores.state_predicts_action else "nothing could be learned", nobody)
    if split.lower.gain_upper <= 0 or (data.space.has_density and not scores.state_predicts_action):
        return Claims("nothing could be learned", nobody, lower=split.lower)
    if split.lower.is_rival:
        return two_groups(scoring, scores, split.lower)
    if split is groups and chance is not None:
        split = replace(
            groups, verdicts=np.where(groups.verdicts == 0, chance.verdicts, groups.verdicts), is_cluster=True
        )
    doubts = tuple(doubts_of(scoring, scores, split, order))
    if again is not None and not split.with_other_folds:
        doubts = (Doubt("Another calculation, with other parts of the data held out, finds no outliers."), *doubts)
    if doubts:
        return Claims("in doubt", nobody, doubts, split.lower)
    outlier = split.verdicts < 0
    if not outlier.any():
        return Claims("no outliers", nobody, (), split.lower)
    upper = np.isin(np.arange(len(outlier)), split.lower.upper)
    if SecondWay.of(data, upper, outlier, scoring.settings).is_there:
        return two_groups(scoring, scores, replace(split.lower, rival=np.flatnonzero(outlier)))
    return Claims("outliers", split.verdicts, (), split.lower)


def two_groups(scoring: Scoring, scores: Scores, lower: Lower) -> Claims:
    """The claim that the `lower` group has a policy of its own: neither group holds outliers."""
    nobody = np.zeros(scoring.data.n_demonstrations, dtype=int)
    return Claims("two groups", nobody, (), lower, contrast(scoring, lower, scores.fit.ridge))


@dataclass(frozen=True, eq=False)
class Split:
    """A division of M demonstrations into an upper and a lower group."""

    verdicts: Int[Array, " M"]
    """1 similar, 0 open, -1 outlier, where nothing speaks against it."""
    lower: Lower
    with_other_folds: bool
    """Whether other folds divide the demonstrations as well."""
    is_cluster: bool
    """Whether the lower group is a cluster of its own."""


def by_groups(scoring: Scoring, scores: Scores, again: Scores | None) -> Split | None:
    """The split by the groups of scores; None where they are hardly two."""
    settings, limits = scoring.settings, scoring.settings.claims
    upper = scores.groups.upper(scores.score, scores.variance)
    if scores.groups.p_two < limits.min_p_two or not limits.min_group <= upper.sum() < len(upper):
        return None
    verdicts, agrees = said(scores, limits, upper, scores.log_odds), True
    if again is not None:
        verdicts *= verdicts == np.sign(again.log_odds).astype(int)
        agrees = again.groups.p_two >= limits.min_p_two
    lower = look_below(scoring.data, scoring.model, upper, scores.fit, settings)
    return Split(verdicts, lower, agrees, scores.groups.is_cluster)


def by_chance(scoring: Scoring, scores: Scores, again: Scores | None) -> Split | None:
    """The split of discrete actions by chance: the lower group is explained worse than by the frequencies of actions,
    and a policy of its own explains no more. None where actions are continuous, or the lower group is no noise.

    The scores of an expert are above 0, and those of actions without regard to the state below, by about as much
    (the Kullback-Leibler divergences of the two, either way). A demonstration is an outlier below the threshold
    of -`noise_share` times the median gain of the upper group.
    """
    limits, upper = scoring.settings.claims, scores.score > 0
    no_groups = scores.groups.p_two < limits.min_p_two_of_noise
    if scoring.data.space.has_density or no_groups or not limits.min_group <= upper.sum() < len(upper):
        return None
    lower = look_below(scoring.data, scoring.model, upper, scores.fit, scoring.settings)
    if lower.gain_upper <= 0 or not lower.is_noise:
        return None
    if not is_learnable(scoring.data, scoring.model, upper, int((~upper).sum()), scores.fit.ridge, scoring.settings):
        return None
    dealings = [scores] if again is None else [scores, again]
    similar = np.all([one.score > 0 for one in dealings], axis=0) & in_better_part(scores, upper)
    outlier = np.all([one.score <= -limits.noise_share * lower.gain_upper for one in dealings], axis=0)
    return Split(similar.astype(int) - outlier.astype(int), lower, True, True)


def extended(claims: Claims, scores: Scores, indices: Int[Array, " S"], settings: JudgeSettings) -> Claims:
    """The claims about a sample, at these `indices`, as claims about all demonstrations with `scores`."""
    verdicts = np.zeros(len(scores.score), dtype=int)
    upper = scores.groups.upper(scores.score, scores.variance)
    if claims.verdicts.any():
        verdicts = said(scores, settings.claims, upper, scores.log_odds)
        verdicts[indices] = claims.verdicts
    doubts = tuple(replace(doubt, runs=tuple(indices[run] for run in doubt.runs)) for doubt in claims.doubts)
    lower = claims.lower
    if lower is not None:
        in_upper = upper.copy()
        in_upper[indices[lower.upper]], in_upper[indices[lower.rival]] = True, False
        rival = indices[lower.rival] if claims.finding != "two groups" else np.flatnonzero(~in_upper)
        lower = replace(lower, upper=np.flatnonzero(in_upper), rival=rival)
    return replace(claims, verdicts=verdicts, doubts=doubts, lower=lower)


def said(
    scores: Scores, limits: ClaimSettings, upper: Bool[Array, " M"], log_odds: Float[Array, " M"]
) -> Int[Array, " M"]:
    """The verdicts that scores alone give to M demonstrations, whatever speaks against them."""
    similar = log_odds >= logit(limits.min_proba)
    similar &= in_better_part(scores, upper)
    outlier: Array = log_odds <= -logit(limits.min_proba)
    return np.asarray(similar.astype(int) - outlier.astype(int))


def in_better_part(scores: Scores, upper: Bool[Array, " M"]) -> Bool[Array, " M"]:
    """The `upper` group, or only its better half where the lower group is a tail and not a cluster of its own."""
    if not upper.any():
        return upper
    return np.asarray(upper & (scores.groups.is_cluster | (scores.score >= np.median(scores.score[upper]))))


def doubts_of(scoring: Scoring, scores: Scores, split: Split, order: Float[Array, " M"] | None) -> list[Doubt]:
    """Every reason to doubt that the demonstrations with verdict -1 differ from the others."""
    data, limits = scoring.data, scoring.settings.claims
    log_prob, outlier = scores.fit.log_prob, split.verdicts < 0
    doubts = []
    if 2 * outlier.sum() > len(outlier) and not split.is_cluster:
        doubts.append(Doubt("More than half score low, at many levels: no limit between two groups is clear."))
    means = data.mean_steps(log_prob), data.mean_steps(log_prob - scoring.log_q)
    agreement = np.corrcoef([mean_ranks(mean) for mean in means])[0, 1]  # Spearman's
    if data.space.has_density and agreement < limits.min_agreement:
        sentence = "Two ways of scoring disagree about the order (rank correlation"
        doubts.append(Doubt(f"{sentence} {agreement:.2f}), so the low scores may be an artefact."))
    if order is not None and outlier.any() and runs_p(outlier[np.argsort(order, kind="stable")]) < limits.max_runs_p:
        doubts.append(Doubt(FEW_RUNS, runs_of(outlier, order)))
    doubts += doubts_of_operators(data.demonstrators, split.verdicts, limits)
    return doubts


def runs_of(member: Bool[Array, " M"], order: Float[Array, " M"]) -> tuple[Int[Array, " _"], ...]:
    """The members in runs in which one follows another in the `order`."""
    by_order = np.argsort(order, kind="stable")
    places = np.flatnonzero(member[by_order])
    return tuple(by_order[run] for run in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1))


def runs_p(member: Bool[Array, " M"]) -> float:
    """Probability of so few runs of members and others in a random order (Wald and Wolfowitz 1940)."""
    a, b = int(member.sum()), int((~member).sum())
    if min(a, b) == 0:
        return 1.0
    n, runs = a + b, 1 + int((member[1:] != member[:-1]).sum())
    mean = 1 + 2 * a * b / n
    variance = max((mean - 1) * (mean - 2) / (n - 1), 1e-12)
    return float(ndtr((runs + 0.5 - mean) / np.sqrt(variance)))


def doubts_of_operators(demonstrators: Demonstrators, verdicts: Int[Array, " M"], limits: ClaimSettings) -> list[Doubt]:
    """A doubt where all outliers, two at least, are of one operator; or most are of operators without a
    similar one, although by chance they would have one: (1 - share of similar ones) ** demonstrations < `max_runs_p`.
    """
    outlier, similar = verdicts < 0, verdicts > 0
    if not demonstrators.informative or outlier.sum() < 2:
        return []
    n_outliers = demonstrators.indicator @ outlier
    chance = (1 - similar.mean()) ** demonstrators.counts
    apart = (demonstrators.indicator @ similar == 0) & (n_outliers > 0) & (chance < limits.max_runs_p)
    whose = "Most low scores are of operators without a similar demonstration ({operators})"
    if n_outliers.max() == outlier.sum():
        apart, whose = n_outliers > 0, "All low scores are of one operator, {operators}"
    if 2 * n_outliers[apart].sum() <= outlier.sum():
        return []
    sentence = f"{whose}: perhaps a style or a set-up, and not necessarily worse; to judge within each operator"
    names = tuple(demonstrators.names[u] for u in np.flatnonzero(apart))
    return [Doubt(f"{sentence}: --session operator.", operators=names)]


def telling_pair(claims: Claims, score: Float[Array, " M"]) -> tuple[int, int] | None:
    """Two demonstrations, of which an answer says most which is better: the 90 % and the 10 % points of the ranking, or
    the middle members of two groups. Extremes are often odd in other ways. None where all scores are the same."""
    if claims.groups is not None:
        first, second = (int(group[np.argsort(score[group])[len(group) // 2]]) for group in claims.groups)
        return first, second
    order, last = np.argsort(score, kind="stable"), len(score) - 1
    if not np.ptp(score) > 0:
        return None
    return int(order[round(0.9 * last)]), int(order[round(0.1 * last)])
