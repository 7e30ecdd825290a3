"""Parts of an audit: that of some demonstrations, and the one of several tasks or sessions, each judged by itself."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rpil.data.text import listed
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS
from rpil.inference.findings import FINDINGS
from rpil.numerics.types import Array, Float
from rpil.results.judged import AuditSettings, Interval, table_fields
from rpil.results.record import Audit


def first_of(audit: Audit, ids: Sequence[Hashable]) -> Audit:
    """The audit of its first demonstrations alone, which get the names `ids`, as they were judged among all.

    What concerns all, as the finding and the share of experts, stays.
    """
    size, names = len(ids), dict(zip(audit.ids, ids, strict=False))
    rows = {"M": size, "N": int(audit.offsets[size])}
    known = ((name, getattr(audit, name), axis) for name, axis, _ in table_fields(type(audit)))
    columns: dict[str, Any] = {name: column[: rows[axis]] for name, column, axis in known if column is not None}

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
    n_own: int | None = None,
) -> Audit:
    """One audit of the M demonstrations `ids`, from those of their tasks, or `what` the groups are.

    Parameters
    ----------
    audits : mapping of task to Audit
        A task with a single demonstration has none: it stays open.
    places : mapping of task to sequence of int
        The numbers of the demonstrations of each task, in the order of its audit.
        The method counts those below `n_own`, by default all, and none of a reference.
    offsets : (M + 1,) int array
        The first steps of the demonstrations.
    answers : Answers
        Those that are known in all audits.
    """
    width = max((audit.columns.shape[1] for audit in audits.values()), default=0)  # by the components of each task
    parts = [replace(one, own_reasons=one.reasons, columns=widened(one.columns, width)) for one in audits.values()]
    kind = type(parts[0]) if parts else Audit
    rows = [np.asarray(places[task], dtype=np.int64) for task in audits]
    steps = [np.concatenate([np.arange(offsets[m], offsets[m + 1]) for m in own]) for own in rows]
    numbers = {"M": (len(ids), rows), "N": (int(offsets[-1]), steps)}
    columns = {
        name: _joined([getattr(part, name) for part in parts], *numbers[axis], nothing)
        for name, axis, nothing in table_fields(kind)
        if name != "order"  # which has another meaning in each task
    }
    columns["task_of"] = np.asarray(_joined([np.full(len(own), k) for k, own in enumerate(rows)], len(ids), rows, -1))
    if not parts:
        columns["columns"] = np.zeros((len(ids), len(CHANNELS) + 1))
    copies = [own[part.copy_of] for part, own in zip(parts, rows, strict=True)]
    shares = [(audit.prior.mean, audit.prior.low, audit.prior.high) for audit in parts] or [(0.5, 0.0, 1.0)]
    finding = min((audit.finding for audit in parts), key=[*FINDINGS].index, default=[*FINDINGS][-1])
    said = _sentence(audits, places, what, n_own or len(ids))
    return kind(
        **columns,
        ids=tuple(ids),
        offsets=offsets,
        finding=finding,
        prior=Interval(*np.average(shares, axis=0, weights=[*map(len, rows)] or None).tolist()),
        adversary=parts[0].adversary if parts else "",
        identifiable=all(audit.identifiable for audit in parts),
        competing=next((one.competing for one in parts if not one.identifiable and one.finding == finding), ()),
        pair=next((audit.pair for audit in parts if audit.pair), ()),
        method=(said, *dict.fromkeys(one for audit in parts for one in audit.method)),
        demonstrators=tuple(demonstrator for audit in parts for demonstrator in audit.demonstrators),
        answers=answers,
        doubts=tuple(dict.fromkeys(doubt for audit in parts for doubt in audit.doubts)),
        notes=_joined_notes(audits),
        copy_of=np.asarray(_joined(copies, len(ids), rows, np.arange(len(ids))) if parts else np.arange(len(ids))),
        anchor=parts[0].anchor if parts else "none",
        settings=parts[0].settings if parts else AuditSettings(),
        within=what,
    )


def widened(columns: Float[Array, "M C"], width: int) -> Float[Array, "M D"]:
    """The columns, with columns of 0 before the last one; the same where an audit keeps none."""
    n = columns.shape[1]
    return np.insert(columns, [n - 1] * (width - n), 0.0, axis=1) if n else columns


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


def _joined_notes(audits: Mapping[str, Audit]) -> tuple[str, ...]:
    """Each note once, after the tasks in which it holds, unless it holds in all."""
    tasks: dict[str, list[str]] = {}
    for task, audit in audits.items():
        for note in audit.notes:
            tasks.setdefault(note, []).append(task or "no task")
    return tuple(note if len(names) == len(audits) else f"{listed(names)}: {note}" for note, names in tasks.items())


def _sentence(audits: Mapping[str, Audit], places: Mapping[str, Sequence[int]], what: str, n: int) -> str:
    found = {task: audits[task].finding if task in audits else "not judged" for task in places}
    findings = (f"{task or 'no task'} ({sum(m < n for m in rows):,}: {found[task]})" for task, rows in places.items())
    return f"Demonstrations are judged within their {what}: {', '.join(findings)}."
