"""`rpil.audit`: demonstrations judged within their tasks and sessions, by what a recording and its user say of them.

Nothing here needs scikit-learn, whose import takes longer than to judge a small file.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
from threadpoolctl import threadpool_limits

from rpil.data import fit_data
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.fit_data import DemonstratorNames, Outcome
from rpil.estimators.pipeline import FitOptions, FitResult, Settings, fit_full, fit_sampled
from rpil.estimators.task import Labels, Task, answers_of, names_of, with_reference
from rpil.formats import ReadOptions, opened, read_demonstrators
from rpil.formats.columns import ColumnOptions, Names, check_options
from rpil.formats.format import Dataset, Frame
from rpil.formats.recording import Recording
from rpil.inference.answers import Answers
from rpil.numerics.types import Array
from rpil.results.answering import rank_demonstrators, with_answers
from rpil.results.judged import changed_settings, provenance_of
from rpil.results.record import Audit
from rpil.results.step_weights import takeover_signs, weights_of, without_bad_rows
from rpil.results.tasks import first_of, join_audits

MIN_DEMONSTRATIONS = 8
"""Demonstrations of a task at least: with fewer the verdicts are weak, as a note says."""


@dataclass(frozen=True, eq=False)
class Statements:
    """Statements about the demonstrations of a recording, by its user or by the columns that the user named."""

    answers: Answers
    demonstrators: Sequence[Hashable] = ()
    """The name of each, None where it is not known; empty where none is."""
    reference: Recording | None = None
    """Demonstrations that are known to be good, and are judged beside the others."""
    taken_over: tuple[Array, ...] = ()
    """For each demonstration the steps in which a person had taken over, where a column says so; see `Audit`."""

    @classmethod
    def of(
        cls,
        recording: Recording,
        labels: Labels | StrPath | None,
        demonstrators: DemonstratorNames | str | None,
        outcome: Outcome | Names | StrPath | None = None,
        reference: Recording | None = None,
    ) -> Statements:
        """Take what a user says, and else what the columns or files say that were named when the recording was opened.

        A path is a file of labels; a text is a file of demonstrators, or a column. Files may speak of what is left out.
        """
        read, source, facts = recording.demonstrations, recording.description.source, recording.facts
        ids = recording.ids or read.ids
        with_reference = () if reference is None else (reference.facts.outcomes,)
        files = [one for one in recording.options.files if one != recording.options.operator]
        answers = answers_of(labels, (files or None) if outcome is None else outcome, read, ids)
        if outcome is None:  # columns, which the message names
            for name, values, *beside in zip(facts.outcome_names, facts.outcomes, *with_reference, strict=True):
                fit_data.check_outcome(np.concatenate([values, *beside]), f"the outcome {name!r}", source)
            outcomes = np.column_stack([answers.outcomes, *facts.outcomes])
            of_files = (f"{name}.csv" if name in facts.outcome_names else name for name in answers.names)
            answers = replace(answers, outcomes=outcomes, names=(*of_files, *facts.outcome_names))
        named_by, demonstrators = source, recording.options.operator if demonstrators is None else demonstrators
        if isinstance(demonstrators, str):
            named_by, demonstrators = demonstrators, read_demonstrators(demonstrators, recording)
        what = "the demonstrators"
        names = () if demonstrators is None else fit_data.in_order(demonstrators, read.ids, named_by, what, ids)
        taken_over = takeover_signs(recording.interventions, read.offsets, recording.description.fps)
        return cls(answers, names, reference, taken_over)

    def select(self, rows: Sequence[int]) -> Statements:
        """Statements about the demonstrations at `rows`, and of pairs of them."""
        names = [self.demonstrators[m] for m in rows] if self.demonstrators else ()
        taken_over = tuple(self.taken_over[m] for m in rows) if self.taken_over else ()
        return replace(self, answers=self.answers.select(rows), demonstrators=names, taken_over=taken_over)


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


def fit_within_tasks(
    recording: Recording, stated: Statements, options: FitOptions, keeps_policy: bool = True
) -> tuple[Audit, list[tuple[Task, FitResult]]]:
    """The audit of the demonstrations of a recording, each judged within its task and session, beside the reference of
    this task if there is one, and the fits to these. A single one is not judged, and has the verdict of its label, if
    any. A `DataError` where sessions divide nothing, or no reference has a task of the recording."""
    demonstrations, reference = recording.demonstrations, stated.reference
    if recording.options.session:
        fit_data.check_sessions(recording.facts.sessions, recording.options.session, recording.description.source)
    places = split_by_task(demonstrations.ids, recording.tasks, recording.facts.sessions)
    several, fps = len(places) > 1, recording.description.fps or recording.times().fps
    share = several and options.judges  # answers about one task are evidence about another
    fits, audits = list[tuple[Task, FitResult]](), dict[str, Audit]()
    ids, offsets = list[Hashable](demonstrations.ids), demonstrations.offsets
    options = replace(options, engine=None) if several else options
    options.check_answers(stated.answers)
    theirs = {} if reference is None else rows_beside(places, recording, reference)
    for group, rows in places.items():
        if several and len(rows) == 1 and not theirs.get(group):
            continue
        own, said = (demonstrations.select(rows), stated.select(rows)) if several else (demonstrations, stated)
        if reference is not None:
            own = replace(own.select(slice(None)), ids=tuple(map(str, own.ids)))
            own = with_reference(own, reference.demonstrations.select(theirs[group])) if theirs[group] else own
            said = beside_reference(said, theirs[group])
        said = replace(said, answers=Answers.none(len(own)), demonstrators=()) if share else said
        audit, fitted = _fit_group(own, said, options, keeps_policy)
        audit = audits[group] = replace(audit, fps=fps)
        fits.append(fitted)
        if several and reference is not None:
            more = audit.ids[len(rows) :]
            places[group] = [*rows, *range(len(ids), len(ids) + len(more))]
            ids = [*map(str, ids), *more]
            offsets = np.append(offsets, offsets[-1] + np.cumsum(reference.demonstrations.lengths[theirs[group]]))
    if several:
        what = "sessions" if recording.options.session else "tasks"
        what = f"tasks and {what}" if recording.options.session and len({*recording.tasks.values()}) > 1 else what
        settings = replace(options.settings.audit, judge=options.settings.judge, weighs_for_learner=keeps_policy)
        answers = Answers.none(len(ids)) if share else stated.answers
        audit = join_audits(audits, places, ids, offsets, answers, what, len(demonstrations.ids))
        trust = np.repeat(answers.labels >= 0, audit.lengths)  # also of those that are alone in their task
        audit = replace(audit, step_weight=audit.step_weight * trust, settings=settings, fps=fps)
    if share:
        known = stated if reference is None else beside_reference(stated, [m for one in audits for m in theirs[one]])
        audit = _answered_together(audit, known, stated.demonstrators, demonstrations)
    if reference is not None:
        audit = first_of(audit, demonstrations.ids)
        if audit.anchor == "answers":  # a mean of 1 over those that are not of the reference
            audit = replace(audit, step_weight=audit.step_weight / audit.step_weight.mean())
    return _with_facts(audit, recording, stated), fits


def _answered_together(
    audit: Audit, known: Statements, names: Sequence[Hashable], demonstrations: Demonstrations | Dataset
) -> Audit:
    """The joined audit of tasks, with the `names` of those who gave these demonstrations, and all that is known."""
    who = fit_data.group_by_demonstrator(names if any(name is not None for name in names) else None, demonstrations)
    over = np.concatenate(known.taken_over) if known.taken_over else None
    audit = replace(audit, taken_over=over, demonstrators=rank_demonstrators(who, audit.ids))
    method = *audit.method, *filter(None, [who.note])
    return with_answers(replace(audit, step_weight=weights_of(audit), method=method), known.answers)


def rows_beside(places: Mapping[str, list[int]], recording: Recording, reference: Recording) -> dict[str, list[int]]:
    """The numbers of the demonstrations of the reference that have each task, all where either file names no tasks."""
    tasks = {k: recording.tasks.get(str(recording.demonstrations.ids[rows[0]])) for k, rows in places.items()}
    named = [reference.tasks.get(str(name)) for name in reference.demonstrations.ids]
    beside = {k: [m for m, own in enumerate(named) if None in (own, task) or own == task] for k, task in tasks.items()}
    if not any(beside.values()):
        said = "no demonstration of the reference has a task of the data; name tasks alike, or --exclude the column"
        raise DataError(f"{reference.description.source}: {said}.")
    return beside


def beside_reference(stated: Statements, rows: Sequence[int]) -> Statements:
    """Statements about these demonstrations, and then about those at `rows` of the reference, which are good."""
    beside, given, more = stated.reference, stated.answers, len(rows)
    assert beside is not None
    outcomes = np.full((more, given.outcomes.shape[1]), np.nan)
    for k, values in enumerate(beside.facts.outcomes[::-1], 1):  # those of files come first
        outcomes[:, -k] = values[rows]
    labels = np.append(given.labels, np.ones(more, dtype=int))
    answers = replace(given, labels=labels, outcomes=np.concatenate([given.outcomes, outcomes]))
    names = [*stated.demonstrators, *[None] * more] if stated.demonstrators else ()
    return replace(stated, answers=answers, demonstrators=names, taken_over=())  # of two files none states these


def _with_facts(audit: Audit, recording: Recording, stated: Statements) -> Audit:
    """The audit of a recording, with what is stated of demonstrations and steps."""
    if audit.taken_over is not None:
        n = int((np.maximum.reduceat(audit.taken_over, audit.offsets[:-1]) > 0).sum())
        told = f"A person took over in {n:,} of {len(audit.ids):,}: these steps weigh more, those just before less."
        audit = replace(audit, notes=(*audit.notes, told))
    audit = replace(audit, answers=replace(audit.answers, marks=stated.answers.marks))
    weight, facts = without_bad_rows(audit, audit.step_weight), recording.facts
    return replace(audit, sessions=facts.sessions, order=facts.order, step_weight=weight)


def _fit_group(
    demonstrations: Demonstrations | Dataset, stated: Statements, options: FitOptions, keeps_policy: bool
) -> tuple[Audit, tuple[Task, FitResult]]:
    """The audit of demonstrations that are judged together, and their fit."""
    is_named = any(name is not None for name in stated.demonstrators)
    task = Task.of(demonstrations, stated.answers, stated.demonstrators if is_named else None)
    if stated.taken_over:
        task = replace(task, taken_over=np.concatenate(stated.taken_over))
    result = fit_task(task, options, keeps_policy)
    audit, n = result.audit, len(demonstrations)
    if stated.reference is None and n < MIN_DEMONSTRATIONS:
        few = f"{n} demonstrations are too few to judge them well: give {MIN_DEMONSTRATIONS} or more."
        audit = replace(audit, notes=(few, *audit.notes))
    return audit, (task, result)


def fit_task(task: Task, options: FitOptions, keeps_policy: bool = True) -> FitResult:
    """Decide which demonstrations of a task to trust, and fit the final policy if it is kept; the audit says how."""
    options.check(task)
    fit, sample = fit_full, options.settings.sample
    least = sample.min_samples * sample.min_steps  # of data of which a sample is less, however few its coefficients
    may_sample = options.judges and options.policy is None and task.source.offsets[-1] > least
    if may_sample and sample.is_smaller_than(task.source.offsets, options.n_sampled_steps(task)):
        fit = fit_sampled
    with threadpool_limits(1, "blas"):  # thin products gain nothing from threads, and can lose a lot
        result = fit(task, options, keeps_policy)
    own, prior = type(options.policy).__name__, options.settings.mixture.prior
    method = (
        "" if result.p_two is None else f"P(two groups of scores) is {result.p_two:.2f}.",
        f"The policy is linear in {result.features.kind} features."
        if options.policy is None
        else f"The policy is a {own}; each demonstration was scored by a copy that was fitted without it.",
        f"The share of experts was fixed at {prior}." if isinstance(prior, float) and not options.judges else "",
        task.demonstrators.note,
    )
    if not result.converged:
        from sklearn.exceptions import ConvergenceWarning

        message = "EM stopped at max_iter before it converged; raise max_iter or tol."
        warnings.warn(message, ConvergenceWarning, stacklevel=2)
    return replace(result, audit=replace(result.audit, method=tuple(filter(None, method))))


JUDGE_FEATURES = "folded"
"""Features of the judge: no policy is kept, for which others would be chosen."""


def audit(
    data: StrPath | Frame | Demonstrations | Recording | Iterable[object],
    labels: Labels | StrPath | None = None,
    outcome: Names | StrPath | Outcome | None = None,
    *,
    random_state: int = 0,
    settings: Settings | None = None,
    progress: Callable[[str], None] | None = None,
    **columns: Unpack[ReadOptions],
) -> Audit:
    """Judge how far each demonstration can be trusted, within its task and session, as ``rpil audit`` does.

    Parameters
    ----------
    data : path, frame, Demonstrations, Recording or iterable of trajectories
        As for `rpil.read`; large files stay on disk.
    labels : mapping of id to {"good", "bad", "better than ID", "same as ID"}, sequence of such pairs, or path, optional
        Answers about demonstrations, or about rows by (id, start, end), which are good or bad; a path is a CSV file
        (id,label, and perhaps start,end).
    outcome : str or several, mapping or series of id to number, or sequence of M numbers, optional
        How each ended: a column, "length", a CSV file (id,value), or numbers. More is better; with a minus before the
        name less is better. A flag of 0 is bad unless others outweigh it. rpil learns how reliable each of several is.
    random_state : int
        Seed; the same seed gives the same bits.
    settings : Settings, optional
    progress : callable, optional
        Called with one line of text at every stage.
    **columns
        As for `rpil.read`, and ``operator`` (also a file, id,demonstrator), ``task`` and ``session``: see `rpil.open`.

    Returns
    -------
    Audit

    Raises
    ------
    DataError
        One sentence naming the file, the demonstration where there is one, and the remedy.

    Examples
    --------
    >>> audit = rpil.audit("drive.csv", id="trip", action=["steer", "accel"])     # doctest: +SKIP
    >>> audit.to_frame(), audit.question                                          # doctest: +SKIP
    """
    check_options(columns)
    outcome = os.fspath(outcome) if isinstance(outcome, os.PathLike) else outcome
    options = replace(ColumnOptions(**columns), outcome=names_of(outcome))
    recording = opened(data, options)
    operator = options.operator if options.operator in options.files else None
    stated = Statements.of(recording, labels, operator, None if options.outcomes else outcome)
    path = data if isinstance(data, str | os.PathLike) else None
    given = {"labels": labels, "outcome": outcome, "random_state": random_state or None, **columns}
    lines = ((name, repr(value).splitlines()) for name, value in given.items() if value is not None)
    texts = (f", {name}={' '.join(own):.300}" for name, own in lines)
    call = f"rpil.audit({type(data).__name__ if path is None else repr(os.fspath(path))}{''.join(texts)})"
    beside = labels if isinstance(labels, str | os.PathLike) else None, *options.files
    chosen = FitOptions(JUDGE_FEATURES, "auto", random_state, settings or Settings(), progress or (lambda _: None))
    return audit_recording(recording, stated, chosen, path, call, beside)


def audit_recording(
    recording: Recording,
    stated: Statements,
    options: FitOptions,
    path: StrPath | None,
    command: str,
    files: Iterable[StrPath | None],
) -> Audit:
    """The audit of a recording, judged within tasks and sessions.

    The `path` of the recording, where it has one, the `command` and other `files` say where the audit comes from.
    """
    audit, _ = fit_within_tasks(recording, stated, options, keeps_policy=False)
    made = provenance_of(command, options.random_state, changed_settings(options.settings, Settings()), (path, *files))
    return replace(audit, provenance=made)
