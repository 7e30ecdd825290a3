"""Several tasks or sessions in one set of data: each is judged by itself, and the audits become one."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit, logit

from rpil.data.text import listed
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS
from rpil.inference.findings import FINDINGS
from rpil.numerics.types import Array
from rpil.results.demonstrators import Interval
from rpil.results.record import Audit
from rpil.results.settings import AuditSettings
from rpil.results.words import Verdict

MIN_DEMONSTRATIONS = 8
"""Of a task: with fewer the verdicts are weak, and a user is warned."""

ALONE = "Not judged: it is the only demonstration of its task or session."
_FINDINGS = tuple(FINDINGS)


def split_by_task(
    ids: Sequence[Hashable], tasks: Mapping[str, str], sessions: Sequence[str] = ()
) -> dict[str, list[int]]:
    """The numbers of the demonstrations of each task and session, by the `tasks` of the ids as text."""
    places: dict[str, list[int]] = {}
    several = len({tasks.get(str(name), "") for name in ids}) > 1
    for m, name in enumerate(ids):
        task = tasks.get(str(name), "")
        group = f"{task or 'no task'}, {sessions[m]}" if sessions and several else sessions[m] if sessions else task
        places.setdefault(group, []).append(m)
    return places


def join_audits(
    audits: Mapping[str, Audit],
    places: Mapping[str, Sequence[int]],
    ids: Sequence[Hashable],
    offsets: Array,
    what: str = "tasks",
) -> Audit:
    """One audit of the M demonstrations `ids`, from those of their tasks, or `what` the groups are.

    Parameters
    ----------
    audits : mapping of task to Audit
        A task with a single demonstration has none: it stays open.
    places : mapping of task to sequence of int
        The numbers of the demonstrations of each task, in the order of its audit.
    offsets : (M + 1,) int array
        The first steps of the demonstrations.
    """
    n = len(ids)
    columns, steps, interval = _gathered(audits, places, offsets)
    verdicts: list[Verdict] = ["open"] * n
    reasons, deviations = [ALONE] * n, [""] * n
    for task, audit in audits.items():
        for k, m in enumerate(places[task]):
            verdicts[m], reasons[m] = audit.verdicts[k], audit.reasons[k]
            deviations[m] = audit.deviations[k] if audit.deviations else ""
    parts = list(audits.values())
    anchors = {audit.anchor for audit in parts}
    opposed = next((audit for audit in parts if not audit.identifiable), None)
    return Audit(
        ids=tuple(ids),
        offsets=offsets,
        finding=min((audit.finding for audit in parts), key=_FINDINGS.index, default=_FINDINGS[-1]),
        **columns,
        reliability_interval=interval,
        verdicts=tuple(verdicts),
        **steps,
        prior=_mean_prior(parts),
        adversary=parts[0].adversary if parts else "",
        history=np.empty(0),
        identifiable=opposed is None,
        competing=opposed.competing if opposed else (),
        pair=next((audit.pair for audit in parts if audit.pair), ()),
        assumptions=(_sentence(audits, places, what), *dict.fromkeys(s for audit in parts for s in audit.assumptions)),
        demonstrators=tuple(demonstrator for audit in parts for demonstrator in audit.demonstrators),
        answers=_joined_answers(audits, places, n),
        contradicting=tuple(name for audit in parts for name in audit.contradicting),
        doubts=tuple(dict.fromkeys(doubt for audit in parts for doubt in audit.doubts)),
        notes=_joined_notes(audits),
        columns=_joined_columns(audits, places, n),
        copy_of=_joined_copies(audits, places, n),
        traces={name: own for audit in parts for name, own in audit.traces.items()},
        # Each verdict keeps the word of its task; where tasks differ, the probability is what it is without an anchor.
        anchor=anchors.pop() if len(anchors) == 1 else "none",
        deviations=tuple(deviations) if any(deviations) else (),
        sessions=(),
        settings=parts[0].settings if parts else AuditSettings(),
        provenance=None,
        within=what,
        own_reasons=tuple(reasons),
        max_unlike_of_parts=min((audit.max_unlike for audit in parts if "unlike" in audit.verdicts), default=None),
    )


def with_labels_alone(audit: Audit, alone: Sequence[int], labels: Array) -> Audit:
    """The audit where the demonstrations numbered `alone`, which were not judged, have the words of their `labels`, 1
    for good and -1 for bad."""
    signs = np.zeros(len(audit.ids), dtype=np.int64)
    signs[alone] = labels[alone]
    verdicts, reasons = [*audit.verdicts], [*audit.reasons]
    for m in np.flatnonzero(signs):
        verdicts[m] = "good" if signs[m] > 0 else "bad"
        reasons[m] = f"Labelled {verdicts[m]}."
    log_odds = np.where(signs, signs * logit(1 - audit.settings.answers.min_proba_bound), audit.log_odds)
    proba, of_steps = np.where(signs, expit(log_odds), audit.expert_proba), np.repeat(signs, audit.lengths)
    return replace(
        audit,
        log_odds=log_odds,
        from_label=np.where(signs, log_odds, audit.from_label),
        expert_proba=proba,
        verdicts=tuple(verdicts),
        step_weight=np.where(of_steps, np.repeat(proba, audit.lengths), audit.step_weight),
        answers=replace(audit.answers, labels=audit.answers.labels + signs),
        own_reasons=tuple(reasons),
    )


def _gathered(
    audits: Mapping[str, Audit], places: Mapping[str, Sequence[int]], offsets: Array
) -> tuple[dict[str, Array], dict[str, Array], Array]:
    """Numbers of demonstrations and of steps by their names, and the intervals of reliability."""
    n, n_steps = len(offsets) - 1, int(offsets[-1])
    columns = {name: np.zeros(n) for name in ("log_odds", "from_actions", "from_demonstrator", "from_label")}
    columns |= {name: np.full(n, 0.5) for name in ("expert_proba", "reliability")}
    columns |= {"claimed": np.zeros(n, dtype=np.int64)}
    steps = {"step_log_ratio": np.zeros(n_steps), "step_share": np.full(n_steps, 0.5), "step_weight": np.ones(n_steps)}
    interval = np.tile([0.0, 1.0], (n, 1))
    for task, audit in audits.items():
        rows = np.concatenate([np.arange(offsets[m], offsets[m + 1]) for m in places[task]])
        for name, column in columns.items():
            column[places[task]] = getattr(audit, name)
        for name, column in steps.items():
            column[rows] = getattr(audit, name)
        interval[places[task]] = audit.reliability_interval
    return columns | {"columns_within": np.empty((n, 0))}, steps, interval


def _joined_answers(audits: Mapping[str, Audit], places: Mapping[str, Sequence[int]], n: int) -> Answers:
    """The answers of all tasks, by the numbers of the demonstrations among all `n`."""
    joined = Answers.of_labels(np.zeros(n, dtype=np.int64))
    pairs, tied = [joined.pairs], [joined.tied]
    for task, audit in audits.items():
        own, rows = audit.answers, np.asarray(places[task])
        joined.labels[rows], joined.outcome[rows] = own.labels, own.outcome
        pairs.append(rows[own.pairs])
        tied.append(rows[own.tied])
    return replace(joined, pairs=np.concatenate(pairs), tied=np.concatenate(tied))


def _joined_columns(audits: Mapping[str, Audit], places: Mapping[str, Sequence[int]], n: int) -> Array:
    """The columns of all tasks, which are ranks within each; 0 for a demonstration that is not judged. The components
    have another meaning in each task, and are left out."""
    of_each = {task: np.delete(audit.columns, slice(len(CHANNELS), -1), axis=1) for task, audit in audits.items()}
    columns = np.zeros((n, next((own.shape[1] for own in of_each.values()), 0)))
    for task, own in of_each.items():
        columns[places[task]] = own
    return columns


def _joined_copies(audits: Mapping[str, Audit], places: Mapping[str, Sequence[int]], n: int) -> Array:
    """The first of the copies of each demonstration within its task."""
    copy_of = np.arange(n)
    for task, audit in audits.items():
        copy_of[places[task]] = np.asarray(places[task])[audit.copy_of]
    return copy_of


def _joined_notes(audits: Mapping[str, Audit]) -> tuple[str, ...]:
    """Each note once, after the tasks in which it holds, unless it holds in all."""
    tasks: dict[str, list[str]] = {}
    for task, audit in audits.items():
        for note in audit.notes:
            tasks.setdefault(note, []).append(task or "no task")
    return tuple(note if len(names) == len(audits) else f"{listed(names)}: {note}" for note, names in tasks.items())


def _mean_prior(audits: Sequence[Audit]) -> Interval:
    """The shares in the tasks, weighted by their numbers of demonstrations."""
    if not audits:
        return Interval(0.5, 0.0, 1.0)
    weights = [len(audit.ids) for audit in audits]
    shares = [(audit.prior.mean, audit.prior.low, audit.prior.high) for audit in audits]
    return Interval(*np.average(shares, axis=0, weights=weights).tolist())


def _sentence(audits: Mapping[str, Audit], places: Mapping[str, Sequence[int]], what: str) -> str:
    findings = (
        f"{task or 'no task'} ({len(rows):,}: {audits[task].finding if task in audits else 'not judged'})"
        for task, rows in places.items()
    )
    return f"Demonstrations are judged within their {what}: {', '.join(findings)}."
