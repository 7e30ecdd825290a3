"""The judge decides which demonstrations to trust. It runs the stages of `rpil.inference` in order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from rpil.data.fit_data import FitData
from rpil.inference.findings import Finding
from rpil.inference.groups import Groups, expert_share_interval
from rpil.inference.held_out import HeldOutModel
from rpil.inference.labels import Decision, decide
from rpil.inference.rivals import Rival, find_rival, find_style
from rpil.inference.scores import Scores, Scoring
from rpil.inference.settings import JudgeSettings, Minority
from rpil.inference.step_trust import StepTrust, step_trust
from rpil.inference.trimming import fit_trimmed, group_shares
from rpil.mixture.demonstrator_prior import demonstrator_posterior
from rpil.numerics.types import Array, Bool, Float


@dataclass(frozen=True, eq=False)
class Judgement:
    """The result of the judge for M demonstrations of N steps by U demonstrators."""

    finding: Finding
    """One of `rpil.inference.findings.FINDINGS`."""
    from_actions: Float[Array, " M"]
    from_demonstrator: Float[Array, " M"]
    """Log-odds of expert against adversary, nats: by the actions of the demonstration itself, and by the other
    demonstrations of its demonstrator."""
    scores: Scores
    log_ratio: Float[Array, " N"]
    """Held-out log pi - log q of every step; empty where steps are not kept."""
    step_trust: StepTrust
    expert_share: tuple[float, float, float]
    """Share of experts among the demonstrations, and its 95 % interval."""
    rival: Rival | None
    """The rival group, where neither labels nor `minority` decide about it."""
    training_group: Bool[Array, " M"]
    demonstrator_trust: Float[Array, "U 3"]
    """P(expert) of the demonstrations of each demonstrator: mean and 95 % interval."""

    @property
    def log_odds(self) -> Float[Array, " M"]:
        """Log-odds of expert against adversary, nats; labels are not counted."""
        return self.from_actions + self.from_demonstrator

    @property
    def groups(self) -> Groups:
        """One group of scores or two."""
        return self.scores.groups


def judge(
    data: FitData,
    model: HeldOutModel,
    settings: JudgeSettings,
    *,
    seed: int = 0,
    minority: Minority = "ask",
    progress: Callable[[str], None] = lambda _: None,
) -> Judgement:
    """Judge the demonstrations of `data` by the held-out log-probabilities of `model`.

    Parameters
    ----------
    seed : int
        Of the folds that the search for rival groups deals.
    minority : {"ask", "trust", "distrust"}
        What to do about a rival group where no label decides, see `rpil.inference.settings.Minority`.
    progress : callable
        Called with the name of every stage.
    """
    progress("ridge")
    scoring = Scoring.of(data, model, settings)
    progress("fitting the training group")
    scores = score_by_best_group(scoring)
    progress("looking for a rival group")
    if scores.groups.told_apart(settings.groups):
        upper = (scores.log_odds(settings) > 0) & (data.labels >= 0)
        rival = find_rival(data, model, upper, scoring.ridge, settings, seed)
    else:
        rival = find_style(data, model, scoring.ridge, settings, seed)
    decision = decide(scoring, scores, rival, minority)
    fit = decision.scores.fit
    log_ratio = fit.held_out.log_prob - scoring.log_q
    temperature = np.minimum(decision.scores.effective_steps / data.lengths, 1.0)
    steps = step_trust(data, log_ratio, temperature, settings)
    return conclude(data, decision, steps, log_ratio, fit.group, settings)


def score_by_best_group(scoring: Scoring) -> Scores:
    """Scores under policies of ever smaller training groups until they are two groups; if they never are, the scores
    under policies of the first.

    A smaller training group helps only where there were adversaries in the larger one. So an upper group that is larger
    than the previous training group is not the experts' alone, and the search goes on. An upper group that is smaller
    than the training group replaces it once, as in reweighted least squares (Rousseeuw and Leroy 1987).
    """
    data, settings = scoring.data, scoring.settings
    possible = previous = data.labels >= 0
    first: Scores | None = None
    for share in group_shares(data.n_demonstrations, settings.trimming):
        fit = fit_trimmed(data, scoring.model, previous, scoring.ridge, share, settings.trimming.max_iter)
        scores = scoring.score(fit)
        upper = ((scores.log_odds(settings) > 0) & possible) | (data.labels > 0)
        if scores.groups.told_apart(settings.groups) and upper.sum() <= previous.sum():
            if 2 <= upper.sum() < fit.group.sum():
                refitted = scoring.score(scoring.fit_group(upper))
                return refitted if refitted.groups.told_apart(settings.groups) else scores
            return scores
        first, previous = first or scores, fit.group
    assert first is not None
    return first


def conclude(
    data: FitData,
    decision: Decision,
    steps: StepTrust,
    log_ratio: Float[Array, " N"],
    training_group: Bool[Array, " M"],
    settings: JudgeSettings,
) -> Judgement:
    """The finding and the log-odds that follow from a decision, and the judgement that holds them.

    `data` needs no steps, and `log_ratio` and the steps of `steps` may be empty.
    """
    scores, rival, groups = decision.scores, decision.rival, decision.scores.groups
    log_odds = scores.log_odds(settings)
    if rival is not None and decision.minority == "trust":
        log_odds[rival.rival] = np.maximum(log_odds[rival.rival], np.median(log_odds[rival.trusted]))
    log_odds = groups.bounded(log_odds, settings.groups) if decision.log_odds is None else decision.log_odds
    limit = settings.groups.verdict_log_odds
    apart = groups.told_apart(settings.groups) or bool((np.abs(log_odds) >= limit).any())
    from_demonstrator, demonstrator_trust = np.zeros(len(log_odds)), np.empty((0, 3))
    if data.demonstrators.informative:
        posterior = demonstrator_posterior(data.demonstrators, log_odds, data.labels, settings.demonstrators)
        from_demonstrator, demonstrator_trust = posterior.log_odds, posterior.intervals()
    total = log_odds + from_demonstrator
    finding: Finding = "nobody stands out" if scores.state_predicts_action else "nothing could be learned"
    if rival is not None and rival.opposed and decision.minority == "ask":
        finding = "two groups"
    elif apart or (np.abs(total) >= limit).any():  # the latter where demonstrators decide
        finding = "some are unlike"
    return Judgement(
        finding=finding,
        from_actions=log_odds,
        from_demonstrator=from_demonstrator,
        scores=scores,
        log_ratio=log_ratio,
        step_trust=steps,
        expert_share=expert_share_interval(expit(total), 1.0 if apart else groups.p_two),
        rival=rival if finding != "some are unlike" and decision.minority == "ask" else None,
        training_group=training_group,
        demonstrator_trust=demonstrator_trust,
    )
