"""The judge decides which demonstrations are similar; it runs the stages of `rpil.inference` in order.

Answers are no part of it: they say which demonstrations are good from what it found (`rpil.results.answering`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rpil.data.copies import Copies
from rpil.data.fit_data import FitData
from rpil.inference.answered import columns_of
from rpil.inference.channels import StateScale, channels, components, summaries
from rpil.inference.claims import Claims, claim, telling_pair
from rpil.inference.held_out import HeldOutModel, indicators
from rpil.inference.rivals import do_steps_tell
from rpil.inference.scores import Scores, Scoring
from rpil.inference.settings import JudgeSettings
from rpil.inference.step_trust import StepTrust, reliability_of, step_shares
from rpil.inference.trimming import fit_group, fit_trimmed
from rpil.numerics.types import Array, Bool, Float, Int


@dataclass(frozen=True, eq=False)
class Judgement:
    """The result of the judge for M demonstrations of N steps, before anything is asked."""

    scores: Scores
    columns: Float[Array, "M D"]
    """From which answers learn, see `rpil.inference.answered.columns_of`."""
    states: StateScale
    claims: Claims
    pair: tuple[int, int] | None
    """Two demonstrations of which an answer would say most."""
    copy_of: Int[Array, " M"]
    """The first of the copies of each demonstration, which may be itself."""
    columns_within: Float[Array, "M W"]
    """From which answers learn where both of two groups are good, or bad, see `columns_within`."""
    step_trust: StepTrust
    log_ratio: Float[Array, " N"]
    """Held-out log pi - log q of every step; empty where steps are not kept."""

    @property
    def log_odds(self) -> Float[Array, " M"]:
        """Log-odds of similar against outlier, nats."""
        return self.scores.log_odds

    @property
    def verdicts(self) -> Int[Array, " M"]:
        """1 similar, 0 open, -1 outlier: what is claimed, unless the log-odds contradict it."""
        return np.where(np.sign(self.log_odds) == self.claims.verdicts, self.claims.verdicts, 0)

    @property
    def training_group(self) -> Bool[Array, " S"]:
        """Of those from which the policies learned: all, or a sample."""
        return self.scores.fit.group


def judge(
    data: FitData,
    model: HeldOutModel,
    settings: JudgeSettings,
    *,
    seed: int = 0,
    order: Float[Array, " M"] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Judgement:
    """Judge the demonstrations of `data` by the held-out log-probabilities of `model`.

    Parameters
    ----------
    seed : int
        Of the folds of `model`; other folds are dealt once.
    order : (M,) array, optional
        The order in which the demonstrations were made, where it is stated.
    progress : callable
        Called with the name of every stage.
    """
    progress("ridge")
    scoring = Scoring.of(data, model, settings)
    progress("fitting the training group")
    everyone = np.ones(data.n_demonstrations, dtype=bool)
    scores = score_by_best_group(scoring, everyone)
    progress("other folds")
    redealt = model.dealt_again(seed + 1) if scores.groups.p_two >= settings.claims.min_p_two_of_noise else None
    again = None if redealt is None else score_by_best_group(replace(scoring, model=redealt), scores.fit.group)
    progress("what the scores support")
    claims = claim(scoring, scores, again, order)
    log_ratio = scores.fit.log_prob - scoring.log_q
    seen = components(summaries(data, indicators(data)), settings.channels)
    states, columns = described(scoring, scores, seen)
    against = np.zeros(len(log_ratio))
    if claims.finding != "nothing could be learned" and do_steps_tell(data, scores.fit, settings):
        claims, others = replace(claims, do_steps_tell=True), data.per_step((~scores.fit.group).astype(float))
        against = scores.fit.log_prob - scoring.model.cold_copy().evaluate(others, scoring.ridge)
    similar = float(np.median(reliability_of(data, against, settings)[0][scores.fit.group]))
    whole_from = settings.steps.whole_reliability * similar
    shares = step_shares(data, against, settings, whole_from)
    steps = StepTrust(*reliability_of(data, log_ratio, settings), shares, whole_from)
    pair = telling_pair(claims, scores.score)
    within = columns_within(scoring, claims.groups, seen, seed)
    own = np.arange(data.n_demonstrations)
    return Judgement(scores, columns, states, claims, pair, own, within, steps, log_ratio)


def score_by_best_group(scoring: Scoring, start: Bool[Array, " M"]) -> Scores:
    """Scores under policies of the training group; once more under those of the upper group of these scores, where that
    is smaller, without demonstrations that are explained worse than by the frequencies of discrete actions.

    A group fits better once all others are left out, as in reweighted least squares (Rousseeuw and Leroy 1987). Whether
    there are two groups is asked once, of the last scores.
    """
    data, settings = scoring.data, scoring.settings
    trimmed = fit_trimmed(data, scoring.model, start, scoring.ridge, settings.trimming, scoring.monotony)
    first = scoring.score(trimmed)
    upper = first.groups.upper(first.score, first.variance)
    if not data.space.has_density:
        upper &= first.score > 0
    if not settings.claims.min_group <= upper.sum() < first.fit.group.sum():
        return first
    return scoring.score(fit_group(data, scoring.model, upper, scoring.ridge))


def described(scoring: Scoring, scores: Scores, seen: Float[Array, "M K"]) -> tuple[StateScale, Float[Array, "M D"]]:
    """What channels of states are measured by, and the columns from which answers learn, the components `seen` among
    them."""
    data, settings, log_prob = scoring.data, scoring.settings, scores.fit.log_prob
    states = StateScale.of(data, settings.channels)
    step_scores, errors = (log_prob, log_prob - scoring.log_q), settings.held_out.errors
    values = channels(data, scores.score, *step_scores, indicators(data), states, errors)
    return states, columns_of(values, seen, scores.log_odds, settings.answers)


def columns_within(
    scoring: Scoring, groups: tuple[Array, Array] | None, seen: Float[Array, "M K"], seed: int
) -> Float[Array, "M W"]:
    """The columns from which answers learn where both of two `groups` are good, or bad: each is judged by itself, and
    before its last column stands the group, 1 upper and -1 other, so that answers can learn that one is better after
    all; the components are those `seen` of all. A demonstration of neither is better explained by the policy of the
    upper one.

    (M, 0) where there are not two groups, or the policy deals its own folds.
    """
    data, settings = scoring.data, scoring.settings
    none = np.empty((data.n_demonstrations, 0))
    if groups is None:
        return none
    upper, by_group = ~np.isin(np.arange(data.n_demonstrations), groups[1]), dict[bool, Array]()
    for is_upper in (True, False):
        rows = np.flatnonzero(upper == is_upper)
        own = data.select(rows)
        model = scoring.model.dealt_again(seed, own)
        if model is None:
            return none
        within = Scoring.of(own, model, settings)
        scores = score_by_best_group(within, np.ones(own.n_demonstrations, dtype=bool))
        by_group[is_upper] = np.insert(described(within, scores, seen[rows])[1], -1, 1.0 if is_upper else -1.0, axis=1)
    columns = np.empty((data.n_demonstrations, by_group[True].shape[1]))
    columns[upper], columns[~upper] = by_group[True], by_group[False]
    return columns


def repeated(judged: Judgement, copies: Copies, offsets: Int[Array, " M1"]) -> Judgement:
    """The judgement of all demonstrations, with these `offsets`, of which the different ones were `judged`: a copy has
    the scores and the verdicts of the one that was."""
    place, rows, scores, steps = copies.place, copies.rows(offsets), judged.scores, judged.step_trust
    scores = replace(scores, score=scores.score[place], variance=scores.variance[place])
    pair = None
    if judged.pair is not None and not copies.all_same:
        pair = int(copies.first[judged.pair[0]]), int(copies.first[judged.pair[1]])
    return replace(
        judged,
        scores=scores,
        columns=judged.columns[place],
        claims=judged.claims.repeated(copies),
        pair=pair,
        copy_of=copies.copy_of,
        columns_within=judged.columns_within[place],
        step_trust=StepTrust(steps.reliability[place], steps.interval[place], steps.share[rows], steps.whole_from),
        log_ratio=judged.log_ratio[rows],
    )
