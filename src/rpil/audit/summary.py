"""From a judgement, or from EM with a named adversary, to the audit that a user reads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from rpil.audit.record import Audit, Demonstrator, Interval, Verdict, verdict, with_labels
from rpil.data.demonstrators import Demonstrators
from rpil.data.fit_data import FitData
from rpil.inference.judgement import Judgement
from rpil.mixture.em import Result
from rpil.numerics.types import Array

WHOLE = 0.9
"""Reliability, relative to that of a typical expert, from which every step of a demonstration is trained on: a few odd
steps are a misfit of the policy, and leaving them out would bias the policy to where it fits."""


def audit_of(judgement: Judgement, data: FitData, ids: Sequence[Any]) -> Audit:
    """What the judge says of each demonstration."""
    rival, steps = judgement.rival, judgement.steps
    groups = () if rival is None else (rival.trusted, rival.rival)
    log_odds = with_labels(judgement.log_odds, data.labels)
    contested = (judgement.finding != "told apart") & (data.labels == 0)
    unknown = np.isin(judgement.finding, ("cannot be known", "nothing could be learned")) & (data.labels == 0)
    proba = np.where(unknown, 0.5, expit(log_odds))
    verdicts = tuple(verdict(p, unsure) for p, unsure in zip(proba, contested, strict=True))
    return Audit(
        ids=tuple(ids),
        offsets=np.asarray(data.offsets, dtype=np.int64),
        finding=judgement.finding,
        log_odds=log_odds,
        from_actions=judgement.actions,
        from_demonstrator=judgement.demonstrator,
        from_label=log_odds - judgement.log_odds,
        expert_proba=proba,
        reliability=steps.reliability,
        reliability_interval=steps.interval,
        verdicts=verdicts,
        step_log_ratio=judgement.log_ratio,
        step_weight=step_weight(data.lengths, proba, steps.reliability, steps.step),
        prior=Interval(*judgement.share),
        identifiable=judgement.finding != "cannot be known",
        competing=tuple(tuple(ids[m] for m in group) for group in groups),
        to_label=tuple(ids[m] for m in longest(data, groups)),
        adversary="frequent actions" if data.space.kind == "discrete" else "any action",
        history=judgement.scores.history,
        demonstrators=people(data.demonstrators, judgement.people, verdicts),
        labelled=tuple(ids[m] for m in np.flatnonzero(data.labels).tolist()),
    )


def longest(data: FitData, groups: Sequence[Array]) -> list[int]:
    """The longest demonstration of each of the `groups` of indices that has no label yet."""
    free = (group[data.labels[group] == 0] for group in groups)
    return [int(group[np.argmax(data.lengths[group])]) for group in free if len(group)]


def summarise(data: FitData, result: Result, share: Interval, ids: Sequence[Any]) -> Audit:
    """What EM with a named adversary says of each demonstration; `share` is that of experts."""
    posterior = result.posterior
    own = np.nan_to_num(posterior.log_odds, posinf=1e9, neginf=-1e9)
    log_odds = with_labels(own, data.labels)
    proba = expit(log_odds)
    return Audit(
        ids=tuple(ids),
        offsets=np.asarray(data.offsets, dtype=np.int64),
        finding="told apart",
        log_odds=log_odds,
        from_actions=own,
        from_demonstrator=np.zeros(len(own)),
        from_label=log_odds - own,
        expert_proba=proba,
        reliability=proba,  # all steps of a demonstration are the expert's, or none
        reliability_interval=np.stack([proba, proba], axis=1),
        verdicts=tuple(verdict(p, contested=False) for p in proba),
        step_log_ratio=posterior.log_ratio,
        step_weight=data.per_step(proba),
        prior=share,
        adversary=result.state.adversary.name,
        history=result.history,
        labelled=tuple(ids[m] for m in np.flatnonzero(data.labels).tolist()),
    )


def step_weight(
    lengths: Array, proba: Array, reliability: Array, step: Array, typical: float | None = None
) -> NDArray[np.float64]:
    """Weight of each step for training, (N,): P(expert) of its demonstration, times P(the step is an expert's) unless
    the demonstration is as reliable as a `typical` expert's."""
    if not len(step):  # steps are not kept
        return step
    typical = typical_reliability(reliability, proba, lengths) if typical is None else typical
    whole = reliability >= WHOLE * typical
    weight: NDArray[np.float64] = np.repeat(proba, lengths) * np.where(np.repeat(whole, lengths), 1.0, step)
    return weight


def is_anyone_trusted(expert_proba: Array, lengths: Array) -> bool:
    """Whether at least one step is expected to be in an expert's demonstration: sum_m P(expert_m) N_m >= 1.

    Where this is false no demonstration is trusted, and policies learn from single steps instead.
    """
    return bool(expert_proba @ lengths >= 1.0)


def typical_reliability(reliability: Array, expert_proba: Array, lengths: Array) -> float:
    """Median reliability (M,) weighted by P(expert) (M,), or 1 where no demonstration is trusted."""
    if not is_anyone_trusted(expert_proba, lengths):
        return 1.0
    order = np.argsort(reliability)
    return float(reliability[order][np.searchsorted(np.cumsum(expert_proba[order]), 0.5 * expert_proba.sum())])


def people(demonstrators: Demonstrators, trust: Array, verdicts: Sequence[Verdict]) -> tuple[Demonstrator, ...]:
    """The demonstrators, the most trusted first; `trust` (U, 3) is the mean and the 95 % interval of each."""
    if not demonstrators.informative:
        return ()
    found = []
    for u, name in enumerate(demonstrators.names):
        own = [verdicts[m] for m in np.flatnonzero(demonstrators.index == u).tolist()]
        counts = [own.count(of) for of in ("expert", "adversary", "uncertain")]
        if name is not None:
            found.append(Demonstrator(name, Interval(*map(float, trust[u])), len(own), *counts))
    return tuple(sorted(found, key=lambda who: -who.trust.mean))
