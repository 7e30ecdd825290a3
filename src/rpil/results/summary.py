"""The audit that a user reads, from a judgement or from EM with a named adversary; and what its demonstrations do.

The log-ratio of a step is a sum over the parts j of a continuous action, and discrete actions are one part:

    d_j(n) = log pi_j(a_nj|s_n) - log q_j(a_nj)

with Student's densities pi_j around the mean of the policy, q_j whatever the state. The evidence of a part about
demonstration m is what it adds more than in the median one of the rest, sum_n d_j(n) - N_m median_T(mean_n d_j).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import expit

from rpil.data.copies import Copies
from rpil.data.demonstrations import DemonstrationSet
from rpil.data.fit_data import Demonstrators, FitData
from rpil.data.spaces import Discrete
from rpil.data.text import listed, printable
from rpil.inference.answers import Answers
from rpil.inference.findings import DECIDED
from rpil.inference.groups import expert_share_interval
from rpil.inference.held_out import HeldOutRidge, HeldOutSoftmax
from rpil.inference.outliers import Claims
from rpil.inference.parts import ActionScale
from rpil.inference.scores import choose_ridge
from rpil.inference.settings import HeldOutSettings
from rpil.inference.trust import Judgement
from rpil.numerics.regression import error_scale, medians, student_log_densities
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.results.answering import rank_demonstrators, rejecting_rules, shown_proba, verdicts_of, with_answers
from rpil.results.judged import AuditSettings, Interval
from rpil.results.reasons import groups_differ, worst_stretch
from rpil.results.record import Audit
from rpil.results.step_weights import weights_of
from rpil.results.vocabulary import SIDES

if TYPE_CHECKING:
    from rpil.mixture.em import MixtureFit


MAX_LOG_ODDS = 1e9
"""Nats. Infinite log-odds become this: of steps that an adversary can never take."""


def audit_from_judgement(
    judgement: Judgement, source: DemonstrationSet, answers: Answers, who: Demonstrators, settings: AuditSettings
) -> Audit:
    """The audit of the judge, of the demonstrations `source` with these answers and demonstrators, if there are any."""
    claims, log_odds, ids = judgement.claims, judgement.scores.log_odds, source.ids
    none, groups = np.zeros(len(ids)), claims.groups
    audit = Audit(
        ids=ids,
        offsets=source.offsets,
        finding=claims.finding,
        log_odds=log_odds,
        from_actions=log_odds,
        from_label=none,
        expert_proba=shown_proba(log_odds, claims.verdicts, claims.finding, settings.min_proba("none")),
        reliability=judgement.reliability,
        verdicts=verdicts_of(claims.verdicts, "none"),
        step_log_ratio=judgement.log_ratio,
        step_weight=np.ones(len(judgement.log_ratio)),
        prior=Interval(*expert_share_interval(expit(log_odds), judgement.scores.groups.p_two)),
        identifiable=groups is None,
        competing=() if groups is None else tuple(tuple(ids[m] for m in group) for group in groups),
        pair=() if judgement.pair is None else tuple(ids[m] for m in judgement.pair),
        adversary="frequent actions" if source.is_discrete else "any action",
        demonstrators=rank_demonstrators(who, ids),
        answers=answers,
        notes=notes_of(claims, judgement.columns, source.lengths, who),
        columns=judgement.columns,
        claimed=claims.verdicts.astype(np.int64),
        part=judgement.part,
        copy_of=judgement.copy_of,
        settings=settings,
    )
    notes = (*audit.notes, *filter(None, [whom_it_trusts(audit)]))
    return with_answers(replace(audit, step_weight=weights_of(audit), notes=notes), answers)


def notes_of(
    claims: Claims, columns: Float[Array, "M D"], lengths: Int[Array, " M"], who: Demonstrators
) -> tuple[str, ...]:
    """How two groups differ, or that all outliers are of one operator."""
    if claims.groups is not None:
        return groups_differ(claims.groups, columns, lengths)
    outlier = claims.verdicts < 0
    if not who.informative or outlier.sum() < 2 or len({*who.index[outlier].tolist()}) > 1:
        return ()
    name = printable(who.names[who.index[outlier][0]])
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
    names = data.action_names or range(len(data.judged))
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


COMPARED = (*DECIDED, "a group apart")
"""The findings with which there is a rest to compare with."""

BAND = 0.05, 0.95
"""Quantiles of what the rest do, which are named."""

MAX_STEPS = 20
"""Steps of a stretch that are compared, those with the lowest log-ratios: enough to name an action."""

MIN_NATS = 1e-6
"""Evidence that is more than rounding."""

MIN_SHARE = 0.3
"""Share of these steps with one other action from which that action is named."""


@dataclass(frozen=True, eq=False)
class StepEvidence:
    """The steps of K demonstrations, beside what the rest do there; J parts of the action."""

    data: FitData
    members: Int[Array, " K"]
    """The numbers of the demonstrations among those of the audit."""
    value: Float[Array, "N J"]
    """The action, or the probability of the discrete action taken."""
    low: Float[Array, "R J"]
    high: Float[Array, "R J"]
    """The band of the rest."""
    nats: Float[Array, "R J"]
    """The log-ratio of each part, less that of the median one of the rest a step, in nats; the last three are empty
    where actions are discrete."""

    @classmethod
    def of(
        cls,
        data: FitData,
        members: Int[Array, " K"],
        expected: Float[Array, "N ..."],
        rest: Bool[Array, " K"],
        settings: HeldOutSettings,
    ) -> StepEvidence:
        """Compare with the means `expected` of a policy, (N, A), or the log-probabilities of the actions, (N,)."""
        if isinstance(data.space, Discrete):
            none = np.empty((0, 1))
            return cls(data, members, np.exp(expected)[:, None], none, none, none)
        # d_j, with the scale of the errors of the rest
        scaling, errors = ActionScale.of(data), settings.errors
        actions = scaling(data.actions)
        away, middle = actions - (expected - scaling.location) / scaling.spread, medians(actions.T)
        scale = error_scale(away, data.per_step(rest.astype(float)), errors)
        width = error_scale(actions - middle, np.ones(len(actions)), errors)
        log_ratio = student_log_densities(away, scale, errors) - student_log_densities(actions - middle, width, errors)
        ends = np.quantile((data.actions - expected)[data.per_step(rest)], BAND, axis=0)
        low, high = (np.clip(expected + end, data.space.low, data.space.high) for end in ends)  # nobody acts beyond
        usual = np.median((data.sum_steps(log_ratio) / data.lengths[:, None])[rest], axis=0)
        return cls(data, members, data.actions, low, high, log_ratio - usual)


def by_held_out_policies(
    judgement: Judgement, model: HeldOutSoftmax | HeldOutRidge, copies: Copies, settings: HeldOutSettings
) -> StepEvidence:
    """By held-out policies of a linear `model` where actions are continuous, without `copies` of others."""
    fit, data, group = judgement.scores.fit, model.data, judgement.scores.fit.group
    if data.space.kind == "discrete":
        expected = fit.log_prob
    else:
        assert isinstance(model, HeldOutRidge)
        ridge = fit.ridge or choose_ridge(data, model, group)  # the user's policy has none
        expected = ActionScale.of(data).back(model.actions - model.errors(data.per_step(group.astype(float)), ridge))
    return StepEvidence.of(data, copies.judged, expected, ~judgement.claims.lower[copies.judged], settings)


def deviations(audit: Audit, evidence: StepEvidence, classes: Array) -> tuple[str, ...]:
    """A phrase for each demonstration with a stretch of bad steps, and "" for all others, (M,).

    Of discrete actions, codes of `classes`, it is the most frequent one of those that others mostly do not take there.
    Of continuous actions it is the part with most of the evidence. It takes a group to compare with.
    """
    has_rest = audit.anchor == "none" or "upper" in map(SIDES.get, audit.verdicts)
    if audit.finding not in COMPARED or not has_rest:
        return ()
    phrases, data = [], evidence.data
    for m, place in enumerate(np.searchsorted(evidence.members, audit.copy_of).tolist()):
        log_ratio = audit.log_ratio(m)
        stretch = worst_stretch(log_ratio)
        if stretch is None:
            phrases.append("")
            continue
        own = np.arange(stretch[0], stretch[1] + 1)
        steps = own[np.argsort(log_ratio[own], kind="stable")[:MAX_STEPS]]  # the worst ones
        rows = data.offsets[place] + steps
        if data.space.kind != "discrete":
            phrases.append(_far_part(evidence, rows, steps))
            continue
        unlikely = evidence.value[rows, 0] < 0.5  # by the policy of the rest
        (own, count), *_ = *Counter(classes[data.actions[rows[unlikely]]].tolist()).most_common(1), (None, 0)
        often, share = count >= MIN_SHARE * len(rows), f"{count} of its {len(rows)} worst steps"
        phrases.append(f"it takes action {printable(own)} where others mostly take another ({share})" if often else "")
    return tuple(phrases)


def _far_part(evidence: StepEvidence, rows: Int[Array, " R"], steps: Int[Array, " R"]) -> str:
    """The part of the action with most of the evidence in these steps, in that step of them in which it leaves the band
    of the rest by the median distance; "" where it does not."""
    nats = evidence.nats[rows].sum(axis=0)
    toward = np.maximum(nats if nats.sum() > 0 else -nats, 0.0)
    if toward.sum() <= MIN_NATS:
        return ""
    j = int(np.argmax(toward))
    value, low, high = (each[rows, j] for each in (evidence.value, evidence.low, evidence.high))
    away = np.maximum(low - value, value - high)
    own = int(np.argsort(away, kind="stable")[len(away) // 2])
    if away[own] <= 0:
        return ""
    data = evidence.data
    name = data.action_names[j] if data.action_names else f"action part {j}" if data.space.n_parts > 1 else "action"
    its = f"at step {steps[own]}: {printable(name)} is"
    differences = [size for size in (high[own] - low[own], away[own]) if size > 0]
    decimals = max(0, -math.floor(math.log10(min(differences))))  # the digits that tell the value and the band apart
    numbers = (round(number, decimals) + 0.0 for number in (value[own], low[own], high[own]))  # no minus zero
    is_at, first, last = (f"{number:.{decimals}f}" for number in numbers)
    band = first if first == last else f"{first} to {last}"
    return f"{its} {is_at}; others there have {band}"
