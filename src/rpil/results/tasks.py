"""Parts of an audit: that of some demonstrations, and the one of several tasks or sessions, each judged by itself."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import expit, logit

from rpil.data.text import listed
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS
from rpil.inference.findings import FINDINGS
from rpil.numerics.types import Array, Int
from rpil.results.judged import Interval, table_fields
from rpil.results.record import Audit
from rpil.results.settings import AuditSettings

_FINDINGS = tuple(FINDINGS)


def select(audit: Audit, indices: Sequence[int], ids: Sequence[Hashable] | None = None) -> Audit:
    """The audit of the demonstrations at `indices` alone, in that order, as they were judged among all.

    `ids` are new names for them. What concerns all, as the finding and the share of experts, stays.
    """
    chosen = np.asarray(indices, dtype=np.int64)
    rows = {"M": chosen, "N": _steps_of(audit.offsets, chosen)}
    with_reasons = replace(audit, own_reasons=audit.reasons)
    columns = {name: _taken(getattr(with_reasons, name), rows[axis]) for name, axis, _ in table_fields(type(audit))}
    _, first, place = np.unique(audit.copy_of[chosen], return_index=True, return_inverse=True)
    names = dict(zip((audit.ids[m] for m in chosen.tolist()), ids or _taken(audit.ids, chosen), strict=True))

    def named(old: Sequence[Hashable]) -> tuple[Hashable, ...]:
        return tuple(names[name] for name in old if name in names)

    return replace(
        audit,
        **columns,
        ids=tuple(names.values()),
        offsets=np.concatenate([[0], np.cumsum(audit.lengths[chosen])]),
        competing=tuple(map(named, audit.competing)),
        pair=pair if len(pair := named(audit.pair)) == 2 else (),
        demonstrators=tuple(
            replace(who, demonstrations=own) for who in audit.demonstrators if (own := named(who.demonstrations))
        ),
        answers=audit.answers.select(chosen.tolist()),
        copy_of=first[place],
        contradicting=named(audit.contradicting),
        traces={names[name]: own for name, own in audit.traces.items() if name in names},
    )


def _steps_of(offsets: Int[Array, " _"], rows: Int[Array, " R"]) -> Int[Array, " S"]:
    """The numbers of the steps of some demonstrations."""
    return np.concatenate([np.arange(0), *(np.arange(offsets[m], offsets[m + 1]) for m in rows.tolist())])


def _taken(column: Any, rows: Int[Array, " R"]) -> Any:
    """Some rows of a column; one that is not known stays so."""
    if isinstance(column, np.ndarray):
        return column[rows]
    return tuple(column[m] for m in rows.tolist()) if column else column


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
    # The components among the columns have another meaning in each task.
    parts = [
        replace(audit, own_reasons=audit.reasons, columns=np.delete(audit.columns, slice(len(CHANNELS), -1), axis=1))
        for audit in audits.values()
    ]
    rows = [np.asarray(places[task], dtype=np.int64) for task in audits]
    kind = type(parts[0]) if parts else Audit
    numbers = {"M": (len(ids), rows), "N": (int(offsets[-1]), [_steps_of(offsets, own) for own in rows])}
    columns = {
        name: _joined([getattr(part, name) for part in parts], *numbers[axis], nothing)
        for name, axis, nothing in table_fields(kind)
        if name != "order"  # which has another meaning in each task
    }
    if not parts:
        columns["columns"] = np.empty((len(ids), 0))
    copy_of = np.arange(len(ids))
    for audit, own in zip(parts, rows, strict=True):
        copy_of[own] = own[audit.copy_of]
    shares = [(audit.prior.mean, audit.prior.low, audit.prior.high) for audit in parts] or [(0.5, 0.0, 1.0)]
    anchors = {audit.anchor for audit in parts}
    finding = min((audit.finding for audit in parts), key=_FINDINGS.index, default=_FINDINGS[-1])
    opposed = next((audit for audit in parts if not audit.identifiable and audit.finding == finding), None)
    return kind(
        **columns,
        ids=tuple(ids),
        offsets=offsets,
        finding=finding,
        prior=Interval(*np.average(shares, axis=0, weights=[*map(len, rows)] or None).tolist()),
        adversary=parts[0].adversary if parts else "",
        identifiable=all(audit.identifiable for audit in parts),
        competing=opposed.competing if opposed else (),
        pair=next((audit.pair for audit in parts if audit.pair), ()),
        assumptions=(_sentence(audits, places, what), *dict.fromkeys(s for audit in parts for s in audit.assumptions)),
        demonstrators=tuple(demonstrator for audit in parts for demonstrator in audit.demonstrators),
        answers=_joined_answers([audit.answers for audit in parts], rows, len(ids)),
        contradicting=tuple(name for audit in parts for name in audit.contradicting),
        doubts=tuple(dict.fromkeys(doubt for audit in parts for doubt in audit.doubts)),
        notes=_joined_notes(audits),
        copy_of=copy_of,
        traces={name: own for audit in parts for name, own in audit.traces.items()},
        # Each verdict is that of its task; where tasks differ, the probability is what it is without an anchor.
        anchor=anchors.pop() if len(anchors) == 1 else "none",
        settings=parts[0].settings if parts else AuditSettings(),
        within=what,
    )


def _joined(columns: Sequence[Any], size: int, numbers: Sequence[Array], nothing: Any) -> Any:
    """One column of all tasks: the values of each of the `columns` at its `numbers`, and `nothing` elsewhere."""
    if any(column is None for column in columns):
        return None
    is_text = isinstance(nothing, str)
    width = np.shape(columns[0] if columns else [nothing])[1:]
    joined = np.full((size, *width), nothing, dtype=object if is_text else None)
    for column, places in zip(columns, numbers, strict=True):
        if len(column):  # a task may know no texts
            joined[places] = column
    return joined if not is_text else tuple(joined) if any(joined) else ()


def with_labels_alone(audit: Audit, alone: Sequence[int], answers: Answers, for_learner: bool) -> Audit:
    """The audit where the demonstrations numbered `alone`, which were not judged, have the verdicts of their labels or
    flags, and for the learner the weights."""
    signs, known = np.zeros(len(audit.ids), dtype=np.int64), audit.answers
    labels, outcomes = known.labels.copy(), np.full((len(signs), answers.outcomes.shape[1]), np.nan)
    outcomes[:, [answers.names.index(name) for name in known.names]] = known.outcomes
    signs[alone], labels[alone], outcomes[alone] = answers.said[alone], answers.labels[alone], answers.outcomes[alone]
    verdicts, reasons, rules = [*audit.verdicts], [*audit.reasons], [*(audit.rejected_by or ("",) * len(signs))]
    for m in np.flatnonzero(signs):
        verdicts[m] = "good" if signs[m] > 0 else "bad"
        reasons[m] = f"Labelled {verdicts[m]}." if labels[m] else f"{answers.failure}."
        rules[m] = "" if signs[m] > 0 else "labels" if labels[m] else "outcome"
    log_odds = np.where(signs, signs * logit(1 - audit.settings.judge.answers.min_proba_bound), audit.log_odds)
    proba, of_steps = np.where(signs, expit(log_odds), audit.expert_proba), np.repeat(signs != 0, audit.lengths)
    return replace(
        audit,
        log_odds=log_odds,
        from_label=np.where(signs, log_odds, audit.from_label),
        expert_proba=proba,
        verdicts=tuple(verdicts),
        step_weight=np.where(for_learner & of_steps, np.repeat(proba, audit.lengths), audit.step_weight),
        answers=replace(known, labels=labels, outcomes=outcomes, names=answers.names, flag=answers.flag),
        own_reasons=tuple(reasons),
        rejected_by=tuple(rules),
    )


def _joined_answers(of_tasks: Sequence[Answers], numbers: Sequence[Array], n: int) -> Answers:
    """The answers of all tasks, by the `numbers` of their demonstrations among all `n`."""
    joined, names = Answers.none(n), tuple(dict.fromkeys(name for answers in of_tasks for name in answers.names))
    outcomes = np.full((n, len(names)), np.nan)
    for answers, places in zip(of_tasks, numbers, strict=True):
        joined.labels[places] = answers.labels
        for name, values in zip(answers.names, answers.outcomes.T, strict=True):
            outcomes[places, names.index(name)] = values
    pairs = [places[answers.pairs] for answers, places in zip(of_tasks, numbers, strict=True)]
    tied = [places[answers.tied] for answers, places in zip(of_tasks, numbers, strict=True)]
    both = np.concatenate([joined.pairs, *pairs]), np.concatenate([joined.tied, *tied])
    flags = {answers.names[answers.only_flag] for answers in of_tasks if answers.names and answers.only_flag >= 0}
    flag = names.index(flags.pop()) if len(flags) == 1 else -1
    told = [
        (name, sign) for answers in of_tasks for name, sign in zip(answers.names, answers.heard or (), strict=False)
    ]
    heard = tuple(max((sign for name, sign in told if name == own), key=abs, default=1) for own in names)
    joined = replace(joined, outcomes=outcomes, names=names, flag=flag, heard=heard if told else None)
    return replace(joined, pairs=both[0], tied=both[1])


def _joined_notes(audits: Mapping[str, Audit]) -> tuple[str, ...]:
    """Each note once, after the tasks in which it holds, unless it holds in all."""
    tasks: dict[str, list[str]] = {}
    for task, audit in audits.items():
        for note in audit.notes:
            tasks.setdefault(note, []).append(task or "no task")
    return tuple(note if len(names) == len(audits) else f"{listed(names)}: {note}" for note, names in tasks.items())


def _sentence(audits: Mapping[str, Audit], places: Mapping[str, Sequence[int]], what: str) -> str:
    findings = (
        f"{task or 'no task'} ({len(rows):,}: {audits[task].finding if task in audits else 'not judged'})"
        for task, rows in places.items()
    )
    return f"Demonstrations are judged within their {what}: {', '.join(findings)}."
