"""The judge ranks demonstrations and says which differ; it runs the stages of `rpil.inference` in order.

Answers are no part of it: they say which demonstrations are good from what it found (`rpil.results.answering`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rpil.data.copies import Copies
from rpil.data.fit_data import FitData
from rpil.inference.channels import channels, columns_of, components, spread_of, summaries
from rpil.inference.held_out import HeldOutModel, indicators
from rpil.inference.outliers import Claims, claim, telling_pair
from rpil.inference.scores import Scores, Scoring
from rpil.inference.settings import JudgeSettings
from rpil.inference.two_parts import two_parts
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Judgement:
    """The result of the judge for M demonstrations of N steps, before anything is asked."""

    scores: Scores
    columns: Float[Array, "M D"]
    """From which answers learn, see `rpil.inference.channels.columns_of`."""
    spread: Float[Array, " F"]
    """Standard deviation of the features."""
    claims: Claims
    copy_of: Int[Array, " M"]
    """The first of the copies of each demonstration, which may be itself."""
    reliability: Float[Array, " M"]
    """Share of the steps whose actions the policy explains better than the frequencies of actions do."""
    log_ratio: Float[Array, " N"]
    """Held-out log pi - log q of every step; empty where steps are not kept."""
    part: Float[Array, " M"]
    """1 in the part that a learner trusts, see `rpil.inference.two_parts`; 0 where no policy is learned."""

    @property
    def pair(self) -> tuple[int, int] | None:
        """Two demonstrations of which an answer would say most; neither is a copy of another one."""
        first = np.unique(self.copy_of)
        pair = telling_pair(replace(self.claims, lower=self.claims.lower[first]), self.scores.log_odds[first])
        return None if pair is None else (int(first[pair[0]]), int(first[pair[1]]))


def judge(
    data: FitData,
    model: HeldOutModel,
    settings: JudgeSettings,
    progress: Callable[[str], None] = lambda _: None,
    learner: FitData | None = None,
) -> Judgement:
    """Judge the demonstrations of `data` by the held-out log-probabilities of `model`.

    Parameters
    ----------
    progress : callable
        Called with the name of every stage.
    learner : FitData, optional
        The same demonstrations with the features of a linear policy, where the part that a learner trusts is wanted.
    """
    progress("ridge")
    scoring = Scoring.of(data, model, settings)
    progress("fitting the training group")
    scores = score_by_best_group(scoring)
    progress("what the scores support")
    claims, log_ratio = claim(scoring, scores), scores.fit.log_prob - scoring.log_q
    actions, spread = indicators(data), spread_of(data)
    facts = channels(data, log_ratio, actions, spread)
    seen = components(summaries(data, actions), settings.channels)
    columns, own = columns_of(scores.log_odds, facts, seen, scores.score), np.arange(data.n_demonstrations)
    part = np.zeros(len(own)) if learner is None else two_parts(learner, scores, claims.verdicts < 0, settings)
    return Judgement(scores, columns, spread, claims, own, data.mean_steps(log_ratio > 0), log_ratio, part)


def score_by_best_group(scoring: Scoring) -> Scores:
    """Scores under policies of the training group; once more under those of the upper group of these scores, where that
    is smaller, without demonstrations that are explained worse than by the frequencies of discrete actions.

    A group fits better once all others are left out, as in reweighted least squares (Rousseeuw and Leroy 1987). Whether
    there are two groups is asked once, of the last scores.
    """
    first = scoring.score(scoring.fit_trimmed())
    upper = first.groups.upper(first.score, first.variance)
    if not scoring.data.space.has_density:
        upper &= first.score > 0
    if not scoring.settings.outliers.min_group <= upper.sum() < first.fit.group.sum():
        return first
    return scoring.score(scoring.fit(upper))


def repeated(judged: Judgement, copies: Copies, offsets: Int[Array, " M1"]) -> Judgement:
    """The judgement of all demonstrations, with these `offsets`, of which the different ones were `judged`: a copy has
    the scores and the verdicts of the one that was."""
    place, scores = copies.place, judged.scores
    return replace(
        judged,
        scores=replace(scores, **{each: getattr(scores, each)[place] for each in ("score", "variance", "excess")}),
        columns=judged.columns[place],
        claims=judged.claims.repeated(copies),
        copy_of=copies.copy_of,
        reliability=judged.reliability[place],
        log_ratio=judged.log_ratio[copies.rows(offsets)],
        part=judged.part[place],
    )
