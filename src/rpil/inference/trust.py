"""The judge decides which demonstrations are similar, and, where answers are given, which are good.

It runs the stages of `rpil.inference` in order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit

from rpil.data.copies import Copies
from rpil.data.fit_data import FitData
from rpil.inference.answered import Answered, answer, columns_of, learned_from, with_group
from rpil.inference.answers import Answers
from rpil.inference.channels import StateScale, channels, components, summaries
from rpil.inference.claims import Claims, claim, telling_pair
from rpil.inference.findings import Finding
from rpil.inference.groups import expert_share_interval
from rpil.inference.held_out import HeldOutModel
from rpil.inference.rivals import do_steps_tell
from rpil.inference.scores import Scores, Scoring
from rpil.inference.settings import JudgeSettings
from rpil.inference.step_trust import StepTrust, reliability_of, step_shares
from rpil.inference.trimming import fit_group, fit_trimmed
from rpil.numerics.types import Array, Bool, Float, Int


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of M demonstrations before anything is asked."""

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


@dataclass(frozen=True, eq=False)
class Judgement(Evidence):
    """The result of the judge for M demonstrations of N steps by U demonstrators."""

    finding: Finding
    verdicts: Int[Array, " M"]
    """1 similar (or good, where answers are given), 0 open, -1 outlier (or bad)."""
    from_actions: Float[Array, " M"]
    from_demonstrator: Float[Array, " M"]
    from_answers: Float[Array, " M"]
    """Log-odds, nats: by the actions of the demonstration itself, by the other demonstrations of its demonstrator
    (where there are answers), and by the answers."""
    answered: Answered | None
    """What the answers say, if there are any."""
    log_ratio: Float[Array, " N"]
    """Held-out log pi - log q of every step; empty where steps are not kept."""
    step_trust: StepTrust
    expert_share: tuple[float, float, float]
    """Share of the upper group among the demonstrations, and its 95 % interval."""
    training_group: Bool[Array, " S"]
    """Of those from which the policies learned: all, or a sample."""
    demonstrator_trust: Float[Array, "U 3"]
    """Mean P of the demonstrations of each demonstrator and its 95 % interval; empty without answers."""

    @property
    def log_odds(self) -> Float[Array, " M"]:
        """Log-odds of similar against outlier, or of good against bad where answers are given, nats."""
        return self.from_actions + self.from_demonstrator + self.from_answers


def judge(
    data: FitData,
    model: HeldOutModel,
    settings: JudgeSettings,
    *,
    seed: int = 0,
    answers: Answers | None = None,
    order: Float[Array, " M"] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Judgement:
    """Judge the demonstrations of `data` by the held-out log-probabilities of `model`.

    Parameters
    ----------
    seed : int
        Of the folds of `model`; other folds are dealt once.
    answers : Answers, optional
        By default nothing is known.
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
    seen = components(summaries(data, scoring.indicators()), settings.channels)
    states, columns = described(scoring, scores, seen)
    against = np.zeros(len(log_ratio))
    if claims.finding != "nothing could be learned" and do_steps_tell(data, scores.fit, settings):
        claims, others = replace(claims, do_steps_tell=True), data.per_step((~scores.fit.group).astype(float))
        against = scores.fit.log_prob - scoring.model.cold_copy().evaluate(others, scoring.ridge)
    similar = float(np.median(reliability_of(data, against, settings)[0][scores.fit.group]))
    whole_from = settings.steps.whole_reliability * similar
    shares = step_shares(data, against, settings, whole_from)
    steps = StepTrust(*reliability_of(data, log_ratio, settings), shares, whole_from)
    answers = answers or Answers.none(data.n_demonstrations)
    pair = telling_pair(claims, scores.score)
    within = columns_within(scoring, claims.groups, seen, seed)
    own = np.arange(data.n_demonstrations)
    evidence = Evidence(scores, columns, states, claims, pair, own, within)
    return conclude(data, evidence, answers, steps, log_ratio, settings)


def score_by_best_group(scoring: Scoring, start: Bool[Array, " M"]) -> Scores:
    """Scores under policies of the training group; once more under those of the upper group of these scores, where that
    is smaller, without demonstrations that are explained worse than by the frequencies of discrete actions.

    A group fits better once all others are left out, as in reweighted least squares (Rousseeuw and Leroy 1987). Whether
    there are two groups is asked once, of the last scores.
    """
    data, settings = scoring.data, scoring.settings
    share, max_iter = settings.trimming.share, settings.trimming.max_iter
    trimmed = fit_trimmed(data, scoring.model, start, scoring.ridge, share, max_iter, scoring.monotony)
    first = scoring.score(trimmed)
    upper = first.groups.upper(first.score, first.variance)
    if data.space.kind == "discrete":
        upper &= first.score > 0
    if not settings.claims.min_group <= upper.sum() < first.fit.group.sum():
        return first
    return scoring.score(fit_group(data, scoring.model, upper, scoring.ridge))


def described(scoring: Scoring, scores: Scores, seen: Float[Array, "M K"]) -> tuple[StateScale, Float[Array, "M D"]]:
    """What channels of states are measured by, and the columns from which answers learn, the components `seen` among
    them."""
    data, settings, log_prob = scoring.data, scoring.settings, scores.fit.log_prob
    states = StateScale.of(data, settings.channels)
    values = channels(data, log_prob, log_prob - scoring.log_q, scoring.indicators(), states, settings.held_out.errors)
    values[:, 0] = scores.score  # agreement
    return states, columns_of(values, seen, scores.log_odds, settings.answers)


def columns_within(
    scoring: Scoring, groups: tuple[Array, Array] | None, seen: Float[Array, "M K"], seed: int
) -> Float[Array, "M W"]:
    """The columns from which answers learn where both of two `groups` are good, or bad: each is judged by itself, and
    its columns are `with_group`; the components are those `seen` of all. A demonstration of neither is better explained
    by the policy of the upper one.

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
        by_group[is_upper] = with_group(described(within, scores, seen[rows])[1], is_upper)
    columns = np.empty((data.n_demonstrations, by_group[True].shape[1]))
    columns[upper], columns[~upper] = by_group[True], by_group[False]
    return columns


def conclude(
    data: FitData,
    evidence: Evidence,
    answers: Answers,
    steps: StepTrust,
    log_ratio: Float[Array, " N"],
    settings: JudgeSettings,
) -> Judgement:
    """The judgement that follows from the evidence and the answers.

    `data` needs no steps, and `log_ratio` and the steps of `steps` may be empty.
    """
    scores, claims, verdicts = evidence.scores, evidence.claims, evidence.claims.verdicts
    from_actions = scores.log_odds
    from_demonstrator, from_answers, trust = np.zeros(len(verdicts)), np.zeros(len(verdicts)), np.empty((0, 3))
    answered = None
    if answers.once(evidence.copy_of).any:
        from rpil.mixture.demonstrator_prior import trust_by_demonstrator

        columns = learned_from(evidence.columns, evidence.columns_within, answers, settings.answers)
        answered = answer(columns, answers, settings.answers, evidence.copy_of, claims.verdicts)
        from_answers = answered.log_odds - from_actions
        verdicts, labels = answered.verdicts, answers.shared(evidence.copy_of).labels
        from_demonstrator, trust = trust_by_demonstrator(
            data.demonstrators, answered.log_odds, labels, evidence.copy_of, settings.demonstrators
        )
    total = from_actions + from_demonstrator + from_answers
    verdicts = verdicts * (np.sign(total) == verdicts)  # a demonstrator withdraws verdicts, and gives none
    p_two = 1.0 if answered is not None else scores.groups.p_two
    return Judgement(
        **vars(evidence),
        finding=claims.finding if answered is None else "answered",
        verdicts=verdicts,
        from_actions=from_actions,
        from_demonstrator=from_demonstrator,
        from_answers=from_answers,
        answered=answered,
        log_ratio=log_ratio,
        step_trust=steps,
        expert_share=expert_share_interval(expit(total), p_two),
        training_group=scores.fit.group,
        demonstrator_trust=trust,
    )


def repeated(judged: Judgement, copies: Copies, data: FitData, answers: Answers, settings: JudgeSettings) -> Judgement:
    """The judgement of all demonstrations of `data`, of which the different ones were `judged`: a copy has the scores
    and the verdicts of the one that was."""
    place, rows, scores, steps = copies.place, copies.rows(data.offsets), judged.scores, judged.step_trust
    scores = replace(scores, score=scores.score[place], variance=scores.variance[place])
    pair = None
    if judged.pair is not None and not copies.all_same:
        pair = int(copies.first[judged.pair[0]]), int(copies.first[judged.pair[1]])
    columns, within = judged.columns[place], judged.columns_within[place]
    evidence = Evidence(scores, columns, judged.states, judged.claims.repeated(copies), pair, copies.copy_of, within)
    steps = StepTrust(steps.reliability[place], steps.interval[place], steps.share[rows], steps.whole_from)
    return conclude(data, evidence, answers, steps, judged.log_ratio[rows], settings)
