"""Parts of an audit: that of some demonstrations, and the one of several tasks or sessions, each judged by itself."""

from __future__ import annotations

import warnings
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import expit, logit

from rpil.data.text import listed
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS
from rpil.inference.findings import FINDINGS
from rpil.numerics.types import Array
from rpil.results.answering import with_answers
from rpil.results.judged import AuditSettings, Interval, failures, table_fields
from rpil.results.record import Audit
from rpil.results.step_weights import without_bad_rows


def first_of(audit: Audit, ids: Sequence[Hashable]) -> Audit:
    """The audit of its first demonstrations alone, which get the names `ids`, as they were judged among all.

    What concerns all, as the finding and the share of experts, stays.
    """
    size, names = len(ids), dict(zip(audit.ids, ids, strict=False))
    rows = {"M": size, "N": int(audit.offsets[size])}
    columns: dict[str, Any] = {}
    for name, axis, _ in table_fields(type(audit)):
        column = getattr(audit, name)
        columns[name] = column if column is None else column[: rows[axis]]

    def named(old: Sequence[Hashable]) -> tuple[Hashable, ...]:
        return tuple(names[name] for name in old if name in names)

    demonstrators = ((who, named(who.demonstrations)) for who in audit.demonstrators)
    return replace(
        audit,
        **columns,
        ids=tuple(ids),
        offsets=audit.offsets[: size + 1],
        competing=tuple(map(named, audit.competing)),
        pair=pair if len(pair := named(audit.pair)) == 2 else (),
        demonstrators=tuple(replace(who, demonstrations=own) for who, own in demonstrators if own),
        answers=audit.answers.select(range(size)),
        copy_of=audit.copy_of[:size],
        contradicting=named(audit.contradicting),
    )


def join_audits(
    audits: Mapping[str, Audit],
    places: Mapping[str, Sequence[int]],
    ids: Sequence[Hashable],
    offsets: Array,
    answers: Answers,
    what: str = "tasks",
    for_learner: bool = False,
) -> Audit:
    """One audit of the M demonstrations `ids`, from those of their tasks, or `what` the groups are: the numbers of each
    are in `places`. A single one has no audit: it stays open, or has the verdict of its label or flag, and where that
    is `for_learner` the weights. Of the `answers` about all, pairs of different tasks are left out."""
    # The components among the columns have another meaning in each task.
    parts = [
        replace(audit, own_reasons=audit.reasons, columns=np.delete(audit.columns, slice(len(CHANNELS), -1), axis=1))
        for audit in audits.values()
    ]
    kind = type(parts[0]) if parts else Audit
    rows = [np.asarray(places[task], dtype=np.int64) for task in audits]
    steps = [np.concatenate([np.arange(offsets[m], offsets[m + 1]) for m in own]) for own in rows]
    numbers = {"M": (len(ids), rows), "N": (int(offsets[-1]), steps)}
    columns = {
        name: _joined([getattr(part, name) for part in parts], *numbers[axis], nothing)
        for name, axis, nothing in table_fields(kind)
        if name != "order"  # which has another meaning in each task
    }
    if not parts:
        columns["columns"] = np.empty((len(ids), 0))
    copies = [own[part.copy_of] for part, own in zip(parts, rows, strict=True)]
    shares = [(audit.prior.mean, audit.prior.low, audit.prior.high) for audit in parts] or [(0.5, 0.0, 1.0)]
    finding = min((audit.finding for audit in parts), key=[*FINDINGS].index, default=[*FINDINGS][-1])
    opposed = next((audit for audit in parts if not audit.identifiable and audit.finding == finding), None)
    joined = kind(
        **columns,
        ids=tuple(ids),
        offsets=offsets,
        finding=finding,
        prior=Interval(*np.average(shares, axis=0, weights=[*map(len, rows)] or None).tolist()),
        adversary=parts[0].adversary if parts else "",
        identifiable=all(audit.identifiable for audit in parts),
        competing=opposed.competing if opposed else (),
        pair=next((audit.pair for audit in parts if audit.pair), ()),
        method=(_sentence(audits, places, what), *dict.fromkeys(one for audit in parts for one in audit.method)),
        demonstrators=tuple(demonstrator for audit in parts for demonstrator in audit.demonstrators),
        answers=_within(answers, {task: audit.answers for task, audit in audits.items()}, places),
        contradicting=tuple(name for audit in parts for name in audit.contradicting),
        doubts=tuple(dict.fromkeys(doubt for audit in parts for doubt in audit.doubts)),
        notes=_joined_notes(audits),
        copy_of=np.asarray(_joined(copies, len(ids), rows, np.arange(len(ids)))),
        # Each verdict is that of its task; where tasks differ, the probability is what it is without an anchor.
        anchor=parts[0].anchor if len({audit.anchor for audit in parts}) == 1 else "none",
        settings=parts[0].settings if parts else AuditSettings(weighs_for_learner=for_learner),
        within=what,
        by_task=partial(_in_tasks, audits, places),
    )
    alone = [m for task in places.keys() - audits.keys() for m in places[task]]
    return _with_labels_alone(joined, alone, for_learner)


def with_facts(audit: Audit, stated: Answers, source: str = "the labels", **known: Any) -> Audit:
    """The audit with fields that are `known`, and with what is `stated` of it; messages name the `source` of that."""
    if n := len(stated.compared) - len(audit.answers.compared):
        pairs, are = (f"{n} pairs compare", "are") if n > 1 else ("1 pair compares", "is")
        of_two = f"{pairs} demonstrations of different {audit.within}, and {are} left out."
        warnings.warn(f"{source}: {of_two}", stacklevel=1)
    if audit.within and not audit.settings.weighs_for_learner and audit.anchor != "named adversary" and stated.contrast:
        is_bad = np.repeat(failures(audit) | (stated.labels < 0), audit.lengths)  # also where nobody is good
        weight = np.where(is_bad, np.repeat(audit.expert_proba, audit.lengths), audit.step_weight)
        audit = replace(audit, step_weight=weight / weight.mean())
    if audit.taken_over is not None:
        n = int((np.maximum.reduceat(audit.taken_over, audit.offsets[:-1]) > 0).sum())
        told = f"A person took over in {n:,} of {len(audit.ids):,}: these steps weigh more, those just before less."
        audit = replace(audit, notes=(*audit.notes, told))
    audit = replace(audit, answers=replace(audit.answers, marks=stated.marks))
    return replace(audit, **known, step_weight=without_bad_rows(audit, audit.step_weight))


def _in_tasks(audits: Mapping[str, Audit], places: Mapping[str, Sequence[int]], joined: Audit, known: Answers) -> Audit:
    """The audit that was `joined` of several, with all answers that are `known`: each speaks of its own task alone."""
    answered = dict[str, Audit]()
    for task, own in audits.items():
        some = known.select(places[task])  # but for outcomes, which stay those of the task
        some = replace(some, outcomes=own.answers.outcomes, names=own.answers.names, flag=own.answers.flag)
        answered[task] = with_answers(own, some)
    about, of_learner = (joined.ids, joined.offsets, known, joined.within), joined.settings.weighs_for_learner
    kept = {name: getattr(joined, name) for name in ("sessions", "order", "fps", "provenance")}
    return with_facts(join_audits(answered, places, *about, of_learner), known, **kept)


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


def _within(answers: Answers, of_tasks: Mapping[str, Answers], places: Mapping[str, Sequence[int]]) -> Answers:
    """The answers without pairs of different tasks, and without outcomes where they are alike in all of a task; and how
    far each outcome is heard, as in the task where it is heard most."""
    group, outcomes = np.zeros(len(answers.labels), dtype=np.int64), answers.outcomes.copy()
    for k, (task, rows) in enumerate(places.items()):
        group[list(rows)] = k
        names = of_tasks[task].names if task in of_tasks else answers.names
        outcomes[np.ix_(rows, [name not in names for name in answers.names])] = np.nan
    pairs, tied = (both[group[both[:, 0]] == group[both[:, 1]]] for both in (answers.pairs, answers.tied))
    told = [(name, sign) for own in of_tasks.values() for name, sign in zip(own.names, own.heard or (), strict=False)]
    heard = tuple(max((sign for name, sign in told if name == own), key=abs, default=1) for own in answers.names)
    return replace(answers, pairs=pairs, tied=tied, outcomes=outcomes, heard=heard if told else None)


def _with_labels_alone(audit: Audit, alone: Sequence[int], for_learner: bool) -> Audit:
    """The audit where the demonstrations numbered `alone`, which were not judged, have the verdicts of their labels or
    flags, and for the learner the weights."""
    known, signs = audit.answers, np.zeros(len(audit.ids), dtype=np.int64)
    signs[alone] = [known.select([m]).said(np.zeros(1))[0] for m in alone]
    verdicts, reasons, rules = [*audit.verdicts], [*audit.reasons], [*(audit.rejected_by or ("",) * len(signs))]
    for m in np.flatnonzero(signs):
        verdicts[m] = "good" if signs[m] > 0 else "bad"
        reasons[m] = f"Labelled {verdicts[m]}." if known.labels[m] else f"{known.failure}."
        rules[m] = "" if signs[m] > 0 else "labels" if known.labels[m] else "outcome"
    log_odds = np.where(signs, signs * logit(1 - audit.settings.judge.answers.min_proba_bound), audit.log_odds)
    proba, of_steps = np.where(signs, expit(log_odds), audit.expert_proba), np.repeat(signs != 0, audit.lengths)
    return replace(
        audit,
        log_odds=log_odds,
        from_label=np.where(signs, log_odds, audit.from_label),
        expert_proba=proba,
        verdicts=tuple(verdicts),
        step_weight=np.where(for_learner & of_steps, np.repeat(proba, audit.lengths), audit.step_weight),
        own_reasons=tuple(reasons),
        rejected_by=tuple(rules),
    )


def _joined_notes(audits: Mapping[str, Audit]) -> tuple[str, ...]:
    """Each note once, after the tasks in which it holds, unless it holds in all."""
    tasks: dict[str, list[str]] = {}
    for task, audit in audits.items():
        for note in audit.notes:
            tasks.setdefault(note, []).append(task or "no task")
    return tuple(note if len(names) == len(audits) else f"{listed(names)}: {note}" for note, names in tasks.items())


def _sentence(audits: Mapping[str, Audit], places: Mapping[str, Sequence[int]], what: str) -> str:
    found = {task: audits[task].finding if task in audits else "not judged" for task in places}
    findings = (f"{task or 'no task'} ({len(rows):,}: {found[task]})" for task, rows in places.items())
    return f"Demonstrations are judged within their {what}: {', '.join(findings)}."
