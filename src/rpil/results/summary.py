"""The audit that a user reads, from a judgement or from EM with a named adversary."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import expit

from rpil.data.fit_data import FitData
from rpil.data.text import listed, printable
from rpil.inference.answers import Answers
from rpil.inference.groups import expert_share_interval
from rpil.inference.outliers import Claims
from rpil.inference.trust import Judgement
from rpil.numerics.types import Array, Float
from rpil.results.answering import rank_demonstrators, rejecting_rules, shown_proba, verdicts_of, with_answers
from rpil.results.judged import AuditSettings, Interval
from rpil.results.reasons import groups_differ
from rpil.results.record import Audit
from rpil.results.step_weights import weights_of

if TYPE_CHECKING:
    from rpil.mixture.em import MixtureFit

MAX_LOG_ODDS = 1e9
"""Nats. Infinite log-odds become this: of steps that an adversary can never take."""


def audit_from_judgement(
    judgement: Judgement, data: FitData, ids: Sequence[Hashable], answers: Answers, settings: AuditSettings
) -> Audit:
    """The audit of the judge, of demonstrations that are called `ids`, and with these answers, if there are any."""
    claims, log_odds = judgement.claims, judgement.log_odds
    none, groups = np.zeros(len(ids)), claims.groups
    share = expert_share_interval(expit(log_odds), judgement.scores.groups.p_two)
    audit = Audit(
        ids=tuple(ids),
        offsets=np.asarray(data.offsets, dtype=np.int64),
        finding=claims.finding,
        log_odds=log_odds,
        from_actions=log_odds,
        from_demonstrator=none,
        from_label=none,
        expert_proba=shown_proba(log_odds, claims.verdicts, claims.finding, settings.min_proba("none")),
        reliability=judgement.reliability,
        verdicts=verdicts_of(claims.verdicts, "none"),
        step_log_ratio=judgement.log_ratio,
        step_weight=np.ones(len(judgement.log_ratio)),
        prior=Interval(*share),
        identifiable=groups is None,
        competing=() if groups is None else tuple(tuple(ids[m] for m in group) for group in groups),
        pair=() if judgement.pair is None else tuple(ids[m] for m in judgement.pair),
        adversary="frequent actions" if data.space.kind == "discrete" else "any action",
        demonstrators=rank_demonstrators(data.demonstrators, np.empty((0, 3)), ids),
        answers=answers,
        notes=notes_of(claims, judgement.columns, data),
        columns=judgement.columns,
        claimed=claims.verdicts.astype(np.int64),
        part=judgement.part,
        copy_of=judgement.copy_of,
        settings=settings,
    )
    notes = (*audit.notes, *filter(None, [whom_it_trusts(audit)]))
    return with_answers(replace(audit, step_weight=weights_of(audit), notes=notes), answers)


def notes_of(claims: Claims, columns: Float[Array, "M D"], data: FitData) -> tuple[str, ...]:
    """How two groups differ, or that all outliers are of one operator."""
    if claims.groups is not None:
        return groups_differ(claims.groups, columns, data.lengths)
    who, outlier = data.demonstrators, claims.verdicts < 0
    if not who.informative or outlier.sum() < 2 or (who.indicator @ outlier).max() < outlier.sum():
        return ()
    name = printable(who.names[int(np.argmax(who.indicator @ outlier))])
    return (f"All outliers are of one operator, {name}: perhaps a style or a set-up, and not necessarily worse.",)


def whom_it_trusts(audit: Audit) -> str:
    """The sentence about the part of the demonstrations that a learner trusts, until answers contrast."""
    if not audit.part.any() or audit.answers.once(audit.copy_of).contrast:
        return ""
    n, sizes = len(audit.ids), np.sort([(audit.part > 0).sum(), (audit.part < 0).sum()])
    if (np.abs(audit.part) < 1).all():
        return f"Two parts, {sizes[1]:,} and {sizes[0]:,}, act differently; without two labels all are trusted."
    return f"The policy trusts {(audit.part > 0).sum():,} of {n:,} that agree; two labels can change this."


def parts_not_judged(data: FitData) -> tuple[str, ...]:
    """A sentence that names the parts of the action that do not move, and so are not judged; none where all are."""
    if data.judged is None or data.judged.all():
        return ()
    names = [*map(data.action_name, range(len(data.judged)))]
    resting = listed(compress(names, ~data.judged), last=", ")
    return (f"{(~data.judged).sum()} of {len(names)} parts of the action never move, and do not count: {resting}.",)


def audit_from_mixture(
    data: FitData, result: MixtureFit, expert_share: Interval, ids: Sequence[Hashable], settings: AuditSettings
) -> Audit:
    """The audit of EM with a named adversary. A demonstration is good or bad as a whole there, so its reliability and
    the weight of its steps are P(expert)."""
    posterior = result.posterior
    from_actions = np.clip(np.nan_to_num(posterior.log_odds), -MAX_LOG_ODDS, MAX_LOG_ODDS)
    # A label is as good as certain.
    labelled = data.labels * np.maximum(np.abs(from_actions), settings.min_label_log_odds)
    log_odds = np.where(data.labels == 0, from_actions, labelled)
    proba, least = expit(log_odds), settings.min_verdict_proba
    audit = Audit(
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
        verdicts=verdicts_of((proba >= least).astype(int) - (proba <= 1 - least), "named adversary"),
        step_log_ratio=posterior.log_ratio,
        step_weight=data.per_step(proba),
        prior=expert_share,
        adversary=result.state.adversary.name,
        answers=Answers.of_labels(data.labels.astype(np.int64)),
        columns=np.empty((len(ids), 0)),
        claimed=np.zeros(len(ids), dtype=np.int64),
        part=np.zeros(len(ids)),
        copy_of=np.arange(len(ids)),
        settings=settings,
    )
    return replace(audit, rejected_by=rejecting_rules(audit))
