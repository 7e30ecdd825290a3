"""Demonstrations judged within their tasks and sessions, by what a recording and its user say of them."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Hashable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import chain
from typing import TypedDict

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.facts import Facts, Outcome, check_outcome, check_sessions, given_order, given_outcome, tells
from rpil.data.files import StrPath
from rpil.data.id_values import Label, Pairs, check_ids, parse_labels
from rpil.data.reference import with_reference
from rpil.estimators.task import DemonstratorNames, Labels
from rpil.formats import read_answers, read_demonstrators
from rpil.formats.dataset import Dataset
from rpil.formats.recording import Recording
from rpil.numerics.types import Array
from rpil.results.evidence import MAX_DRAWN, with_fewer_traces
from rpil.results.record import Audit
from rpil.results.subset import select
from rpil.results.tasks import MIN_DEMONSTRATIONS, join_audits, split_by_task, with_labels_alone


class Beside(TypedDict):
    """Arguments of `RPIL.fit`."""

    demonstrators: DemonstratorNames | None
    outcome: Array | None
    order: Array | None


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of demonstrations beside their steps; answers and demonstrators by ids as text."""

    labels: Mapping[str, Label]
    pairs: Pairs
    demonstrators: Mapping[str, Hashable]
    facts: Facts
    reference: Demonstrations | None = None
    reference_outcome: Array | None = None
    answers_source: str = "the labels"
    """In messages."""

    @classmethod
    def of(
        cls,
        recording: Recording,
        labels: Labels | StrPath | None,
        demonstrators: DemonstratorNames | str | None,
        outcome: Outcome | None,
        order: Sequence[float] | Array | None,
        reference: Recording | None = None,
    ) -> Known:
        """What a user says, and where he is silent, what the columns say that were named when it was opened.

        A path is a file of labels; a text is a file of demonstrators, or their column. Files may speak of
        demonstrations that are in the data and were left out.
        """
        read, source, facts = recording.demonstrations.ids, recording.description.source, recording.facts
        ids = recording.ids or read
        if isinstance(labels, str | os.PathLike):
            where, (by_name, pairs) = str(labels), read_answers(labels, ids)
            check_ids([*by_name, *chain.from_iterable(pairs)], ids, where, "the labels")
        else:
            where, (by_name, pairs) = "the labels", parse_labels(labels, ids)
            check_ids([*by_name, *chain.from_iterable(pairs)], ids, source, where)
        demonstrators = recording.options.operator if demonstrators is None else demonstrators
        if isinstance(demonstrators, str):
            who: Mapping[str, Hashable] = read_demonstrators(demonstrators, recording)
            check_ids(who, ids, demonstrators, "the demonstrators")
        else:
            who = _by_id(demonstrators, read, source, ids)
        if order is not None:
            facts = replace(facts, order=given_order(order, read, source))
        known = cls(by_name, pairs, who, facts, answers_source=where).select(range(len(read)), {*map(str, read)})
        if outcome is not None:
            facts = replace(known.facts, outcome=given_outcome(outcome, read, source), outcome_name="outcome")
            return replace(known, facts=facts)
        return known._beside(reference, source)

    def _beside(self, reference: Recording | None, source: str) -> Known:
        """The same with the demonstrations of the `reference`; a `DataError` where no outcome differs from another."""
        known, outcome = self, self.facts.outcome
        if reference is not None:
            good = reference.demonstrations.select(slice(None))  # in memory
            known = replace(self, reference=good, reference_outcome=reference.facts.outcome)
        if outcome is not None:  # the estimator checks it too, but cannot name the column
            others = [] if known.reference_outcome is None else [known.reference_outcome]
            check_outcome(np.concatenate([outcome, *others]), f"the outcome {self.facts.outcome_name!r}", source)
        return known

    @property
    def answers(self) -> list[tuple[str, str]]:
        """Labels and pairs as ids and words."""
        return [*self.labels.items(), *((m, f"{word} {other}") for (m, other), word in self.pairs.items())]

    @property
    def arguments(self) -> Beside:
        """What `RPIL.fit` takes beside the demonstrations."""
        outcome = self.facts.outcome if tells(self.facts.outcome) else None  # of a session it may be the same for all
        return {"demonstrators": self.demonstrators or None, "outcome": outcome, "order": self.facts.order}

    def select(self, rows: Sequence[int], ids: Set[str]) -> Known:
        """What is known of the demonstrations at `rows`, which are called `ids`; pairs of which both are among them."""
        return replace(
            self,
            labels={m: label for m, label in self.labels.items() if m in ids},
            pairs={pair: word for pair, word in self.pairs.items() if ids >= {*pair}},
            demonstrators={m: name for m, name in self.demonstrators.items() if m in ids},
            facts=self.facts.select(rows),
        )

    def with_good(self, ids: Sequence[str]) -> Known:
        """The same after the reference was appended: the `ids` of its demonstrations are labelled as good."""
        outcome, of_reference = self.facts.outcome, self.reference_outcome
        if outcome is not None and of_reference is not None:
            outcome = np.concatenate([outcome, of_reference])
        labels: dict[str, Label] = {**self.labels, **dict.fromkeys(ids, "good")}
        # No file states the order of two recordings.
        return replace(self, labels=labels, facts=replace(self.facts, outcome=outcome, order=None), reference=None)


def _by_id(
    demonstrators: DemonstratorNames | None, ids: Sequence[object], source: str, known: Sequence[object]
) -> dict[str, Hashable]:
    """The demonstrators by the `ids` of their demonstrations as text; a mapping may have others that are `known`."""
    if isinstance(demonstrators, Mapping):
        check_ids(demonstrators, known, source, "the demonstrators")
        return {str(m): name for m, name in demonstrators.items()}
    if demonstrators is not None and len(demonstrators) != len(ids):
        raise DataError(
            f"{source}: {len(demonstrators)} demonstrators for {len(ids)} demonstrations; give one for each."
        )
    return {} if demonstrators is None else dict(zip(map(str, ids), demonstrators, strict=True))


Judge = Callable[[Demonstrations | Dataset, Known], Audit]
"""Judges demonstrations that belong together."""


def groups_of(recording: Recording, known: Known) -> dict[str, list[int]]:
    """The numbers of the demonstrations of each task and session; a `DataError` where sessions divide nothing."""
    if recording.options.session:
        check_sessions(known.facts.sessions, recording.options.session, recording.description.source)
    return split_by_task(recording.demonstrations.ids, recording.tasks, known.facts.sessions)


def judge_within_tasks(recording: Recording, known: Known, judge: Judge) -> Audit:
    """The audit of the demonstrations of a recording, each judged within its task and session.

    Where there is a reference, its demonstrations are judged beside those of each group. A group of one demonstration
    is not judged, and has the word of its label, if there is one.
    """
    demonstrations, places = recording.demonstrations, groups_of(recording, known)
    if len(places) == 1:
        audit, n = _with_facts(_judged(demonstrations, known, judge), known), len(demonstrations)
        if known.reference is not None or n >= MIN_DEMONSTRATIONS:
            return audit
        few = f"{n} demonstrations are too few to judge them well: give {MIN_DEMONSTRATIONS} or more."
        return replace(audit, notes=(few, *audit.notes))
    what = "sessions" if recording.options.session else "tasks"
    what = f"tasks and {what}" if recording.options.session and len({*recording.tasks.values()}) > 1 else what
    audits: dict[str, Audit] = {}
    n_pairs = 0
    for group, rows in places.items():
        _warn_of_few(group, len(rows), recording)
        own = known.select(rows, {str(demonstrations.ids[m]) for m in rows})
        n_pairs += len(own.pairs)
        if len(rows) > 1 or known.reference is not None:
            judged = _judged(demonstrations.select(rows), own, judge)
            audits[group] = with_fewer_traces(judged, -(-MAX_DRAWN * len(rows) // len(demonstrations)))
    _warn_of_pairs(known.answers_source, len(known.pairs) - n_pairs, what)
    joined = join_audits(audits, places, demonstrations.ids, demonstrations.offsets, what)
    alone = [m for group in places.keys() - audits.keys() for m in places[group]]
    return _with_facts(with_labels_alone(joined, alone, known.labels), known)


def _judged(demonstrations: Demonstrations | Dataset, known: Known, judge: Judge) -> Audit:
    """The audit of the demonstrations, which are judged together with those of the reference if there is one."""
    if known.reference is None:
        return judge(demonstrations, known)
    n, own = len(demonstrations), demonstrations.select(slice(None))  # in memory
    both = with_reference(own, known.reference)
    return select(judge(both, known.with_good([str(name) for name in both.ids[n:]])), range(n), own.ids)


def _with_facts(audit: Audit, known: Known) -> Audit:
    """The audit with the sessions and the order of its demonstrations."""
    return replace(audit, sessions=known.facts.sessions, order=known.facts.order)


def _warn_of_pairs(source: str, n: int, what: str) -> None:
    """Warn where `n` pairs compare demonstrations that are not judged together."""
    if n:
        pairs = f"{n} pairs compare" if n > 1 else "1 pair compares"
        text = f"{source}: {pairs} demonstrations of different {what}, and {'are' if n > 1 else 'is'} left out."
        warnings.warn(text, stacklevel=1)


def _warn_of_few(group: str, n: int, recording: Recording) -> None:
    """Warn where a task or session has too few demonstrations."""
    if n < MIN_DEMONSTRATIONS:
        said, options = recording.description, recording.options
        what = "session" if options.session else "task"
        remedy = "leave out session=" if options.session else f"add exclude={said.task_column!r}"
        warnings.warn(
            f"{said.source}: the {what} {group!r} has {n} demonstrations, too few to judge them well; to judge all "
            f"{what}s as one, {remedy}.",
            stacklevel=1,
        )
