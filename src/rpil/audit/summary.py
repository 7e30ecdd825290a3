"""The audit that a user reads, from a judgement or from EM with a named adversary."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np
from scipy.special import expit

from rpil.audit.record import MAX_LOG_ODDS, Audit, Demonstrator, Interval, apply_labels
from rpil.audit.settings import AuditSettings
from rpil.audit.words import WORDS, Anchor
from rpil.data.demonstrators import Demonstrators
from rpil.data.fit_data import FitData
from rpil.inference.findings import DECIDED, Finding
from rpil.inference.trust import Judgement
from rpil.mixture.em import Result
from rpil.numerics.types import Array, Float, Int


def audit_from_judgement(
    judgement: Judgement, data: FitData, ids: Sequence[Hashable], settings: AuditSettings
) -> Audit:
    """The audit of the judge, of demonstrations that are called `ids`."""
    rival, steps = judgement.rival, judgement.step_trust
    anchor: Anchor = "answers" if data.labels.any() else "none"
    answered = judgement.finding == "some are unlike" and anchor == "answers"
    finding: Finding = "answered" if answered else judgement.finding
    groups = () if rival is None else (rival.trusted, rival.rival)
    unlabelled = data.labels == 0
    log_odds = apply_labels(judgement.log_odds, data.labels, settings)
    proba = expit(log_odds)
    if finding in ("two groups", "nothing could be learned"):
        proba = np.where(unlabelled, 0.5, proba)
    verdicts = tuple(WORDS[anchor].verdict(p, settings.min_verdict_proba) for p in proba)
    if finding not in DECIDED:
        verdicts = tuple("open" if u else v for u, v in zip(unlabelled, verdicts, strict=True))
    return Audit(
        ids=tuple(ids),
        offsets=np.asarray(data.offsets, dtype=np.int64),
        finding=finding,
        log_odds=log_odds,
        from_actions=judgement.from_actions,
        from_demonstrator=judgement.from_demonstrator,
        from_label=log_odds - judgement.log_odds,
        expert_proba=proba,
        reliability=steps.reliability,
        reliability_interval=steps.interval,
        verdicts=verdicts,
        step_log_ratio=judgement.log_ratio,
        step_weight=step_weight(data.lengths, proba, steps.reliability, steps.step, settings),
        prior=Interval(*judgement.expert_share),
        identifiable=finding != "two groups",
        competing=tuple(tuple(ids[m] for m in group) for group in groups),
        to_label=tuple(ids[m] for m in longest_unlabelled(data, groups)),
        adversary="frequent actions" if data.space.kind == "discrete" else "any action",
        history=judgement.scores.fit.history,
        demonstrators=rank_demonstrators(data.demonstrators, judgement.demonstrator_trust, ids),
        labelled=tuple(ids[m] for m in np.flatnonzero(data.labels).tolist()),
        anchor=anchor,
        settings=settings,
    )


def audit_from_mixture(
    data: FitData,
    result: Result,
    expert_share: Interval,
    ids: Sequence[Hashable],
    settings: AuditSettings,
) -> Audit:
    """The audit of EM with a named adversary. A demonstration is good or bad as a whole there, so its reliability and
    the weight of its steps are P(expert)."""
    posterior = result.posterior
    from_actions = np.nan_to_num(posterior.log_odds, posinf=MAX_LOG_ODDS, neginf=-MAX_LOG_ODDS)
    log_odds = apply_labels(from_actions, data.labels, settings)
    proba = expit(log_odds)
    return Audit(
        ids=tuple(ids),
        offsets=np.asarray(data.offsets, dtype=np.int64),
        finding="mixture",
        anchor="named adversary",
        log_odds=log_odds,
        from_actions=from_actions,
        from_demonstrator=np.zeros(len(log_odds)),
        from_label=log_odds - from_actions,
        expert_proba=proba,
        reliability=proba,
        reliability_interval=np.stack([proba, proba], axis=1),
        verdicts=tuple(WORDS["named adversary"].verdict(p, settings.min_verdict_proba) for p in proba),
        step_log_ratio=posterior.log_ratio,
        step_weight=data.per_step(proba),
        prior=expert_share,
        adversary=result.state.adversary.name,
        history=result.history,
        labelled=tuple(ids[m] for m in np.flatnonzero(data.labels).tolist()),
        settings=settings,
    )


def longest_unlabelled(data: FitData, groups: Sequence[Array]) -> list[int]:
    """The longest demonstration without a label of each of the `groups` of indices that has one."""
    unlabelled = (group[data.labels[group] == 0] for group in groups)
    return [int(group[np.argmax(data.lengths[group])]) for group in unlabelled if len(group)]


def step_weight(
    lengths: Int[Array, " M"],
    expert_proba: Float[Array, " M"],
    reliability: Float[Array, " M"],
    step_proba: Float[Array, " N"],
    settings: AuditSettings,
    typical: float | None = None,
) -> Float[Array, " N"]:
    """Weight of each step for training.

        w_n = P(expert_m),                                where reliability_m >= full_weight_reliability * typical
        w_n = P(expert_m) P(step n is an expert's),       elsewhere

    `step_proba` is P(the step is an expert's), empty where steps are not kept, and then so are the weights; `typical`
    is the reliability of a typical expert, by default `typical_reliability`.
    """
    if not len(step_proba):
        return step_proba
    if typical is None:
        typical = typical_reliability(reliability, expert_proba, lengths)
    has_full_weight = np.repeat(reliability >= settings.full_weight_reliability * typical, lengths)
    return np.asarray(np.repeat(expert_proba, lengths) * np.where(has_full_weight, 1.0, step_proba))


def is_anyone_trusted(expert_proba: Float[Array, " M"], lengths: Int[Array, " M"]) -> bool:
    """Whether at least one step is expected to be in an expert's demonstration: sum_m P(expert_m) N_m >= 1.

    Where this is false no demonstration is trusted, and policies learn from single steps instead.
    """
    return bool(expert_proba @ lengths >= 1.0)


def typical_reliability(
    reliability: Float[Array, " M"], expert_proba: Float[Array, " M"], lengths: Int[Array, " M"]
) -> float:
    """Median reliability, weighted by P(expert), or 1 where no demonstration is trusted."""
    if not is_anyone_trusted(expert_proba, lengths):
        return 1.0
    order = np.argsort(reliability)
    return float(reliability[order][np.searchsorted(np.cumsum(expert_proba[order]), 0.5 * expert_proba.sum())])


def rank_demonstrators(
    demonstrators: Demonstrators, trust: Float[Array, "U 3"], ids: Sequence[Hashable]
) -> tuple[Demonstrator, ...]:
    """The demonstrators with a name, the most trusted first; `trust` holds the mean and the 95 % interval of each."""
    if not demonstrators.informative:
        return ()
    ranked = []
    for u, name in enumerate(demonstrators.names):
        if name is not None:
            own = tuple(ids[m] for m in np.flatnonzero(demonstrators.index == u).tolist())
            ranked.append(Demonstrator(name, Interval(*map(float, trust[u])), own))
    return tuple(sorted(ranked, key=lambda demonstrator: -demonstrator.trust.mean))
