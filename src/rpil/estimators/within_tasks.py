"""`rpil.audit`: demonstrations judged within their tasks and sessions, by what a recording and its user say of them.

Nothing here needs scikit-learn, whose import takes longer than to judge a small file.
"""

from __future__ import annotations

import itertools
import os
import warnings
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Unpack, cast

import numpy as np
from threadpoolctl import threadpool_limits

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.fit_data import DemonstratorNames, Outcome, check_outcome, check_sessions, in_order
from rpil.data.text import quoted
from rpil.estimators.pipeline import FitOptions, FitResult, Settings, fit_full, fit_sampled
from rpil.estimators.task import Labels, Task, answers_of, are_names
from rpil.formats import ReadOptions, opened, read_demonstrators
from rpil.formats.columns import ColumnOptions, Names, check_options
from rpil.formats.format import Dataset, Frame
from rpil.formats.recording import Recording
from rpil.inference.answers import Answers
from rpil.numerics.types import Array
from rpil.results.judged import changed_settings, provenance_of
from rpil.results.record import Audit
from rpil.results.step_weights import takeover_signs
from rpil.results.tasks import first_of, join_audits, with_facts

MIN_DEMONSTRATIONS = 8
"""Demonstrations of a task at least: with fewer the verdicts are weak, as a note says."""


@dataclass(frozen=True, eq=False)
class Statements:
    """Statements about the demonstrations of a recording, by its user or by the columns that the user named."""

    answers: Answers
    demonstrators: Sequence[Hashable] = ()
    """The name of each, None where it is not known; empty where none is."""
    answers_source: str = "the labels"
    """In messages."""
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
        outcome: Outcome | Names | None = None,
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
                check_outcome(np.concatenate([values, *beside]), f"the outcome {name!r}", source)
            outcomes = np.column_stack([answers.outcomes, *facts.outcomes])
            of_files = (f"{name}.csv" if name in facts.outcome_names else name for name in answers.names)
            answers = replace(answers, outcomes=outcomes, names=(*of_files, *facts.outcome_names))
        named_by, demonstrators = source, recording.options.operator if demonstrators is None else demonstrators
        if isinstance(demonstrators, str):
            named_by, demonstrators = demonstrators, read_demonstrators(demonstrators, recording)
        names = () if demonstrators is None else in_order(demonstrators, read.ids, named_by, "the demonstrators", ids)
        where = str(labels) if isinstance(labels, str | os.PathLike) else cls.answers_source
        taken_over = takeover_signs(recording.interventions, read.offsets, recording.description.fps)
        return cls(answers, names, where, reference, taken_over)

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
    """The audit of the demonstrations of a recording, each judged within its task and session, beside the reference if
    there is one, and the fits to these. A single one is not judged, and has the verdict of its label, if any.
    A `DataError` where sessions divide nothing."""
    demonstrations, facts = recording.demonstrations, recording.facts
    if recording.options.session:
        check_sessions(facts.sessions, recording.options.session, recording.description.source)
    places = split_by_task(demonstrations.ids, recording.tasks, facts.sessions)
    fps = recording.description.fps or recording.times().fps
    known = {"sessions": facts.sessions, "order": facts.order, "fps": fps}
    if len(places) == 1:
        audit, fitted = _fit_group(demonstrations, stated, options, keeps_policy)
        return with_facts(audit, stated.answers, stated.answers_source, **known), [fitted]
    options, fits, audits = replace(options, engine=None), list[tuple[Task, FitResult]](), dict[str, Audit]()
    what = "sessions" if recording.options.session else "tasks"
    what = f"tasks and {what}" if recording.options.session and len({*recording.tasks.values()}) > 1 else what
    for group, rows in places.items():
        of_group = stated.select(rows)
        if len(rows) > 1 or stated.reference is not None:
            audit, fitted = _fit_group(demonstrations.select(rows), of_group, options, keeps_policy)
            audits[group] = replace(audit, fps=fps)
            fits.append(fitted)
    audit = join_audits(audits, places, demonstrations.ids, demonstrations.offsets, stated.answers, what, keeps_policy)
    return with_facts(audit, stated.answers, stated.answers_source, **known), fits


def _fit_group(
    demonstrations: Demonstrations | Dataset, stated: Statements, options: FitOptions, keeps_policy: bool
) -> tuple[Audit, tuple[Task, FitResult]]:
    """The audit of demonstrations that are judged together, beside a reference if there is one, and their fit."""
    n, ids = len(demonstrations), demonstrations.ids
    if stated.reference is not None:
        first, beside, given = demonstrations.select(slice(None)), stated.reference, stated.answers  # in memory
        demonstrations = with_reference(first, beside.demonstrations.select(slice(None)))
        more = len(demonstrations) - n
        outcomes = np.full((more, given.outcomes.shape[1]), np.nan)
        for k, values in enumerate(beside.facts.outcomes[::-1], 1):  # those of files come first
            outcomes[:, -k] = values
        labels = np.append(given.labels, np.ones(more, dtype=int))  # those of the reference are good
        answers = replace(given, labels=labels, outcomes=np.concatenate([given.outcomes, outcomes]))
        names = [*stated.demonstrators, *[None] * more] if stated.demonstrators else ()
        stated = replace(stated, answers=answers, demonstrators=names, taken_over=())  # of two files none states these
    is_named = any(name is not None for name in stated.demonstrators)
    task = Task.of(demonstrations, stated.answers, stated.demonstrators if is_named else None)
    if stated.taken_over:
        task = replace(task, taken_over=np.concatenate(stated.taken_over))
    result = fit_task(task, options, keeps_policy)
    audit = result.audit if stated.reference is None else first_of(result.audit, ids)
    if stated.reference is None and n < MIN_DEMONSTRATIONS:
        few = f"{n} demonstrations are too few to judge them well: give {MIN_DEMONSTRATIONS} or more."
        audit = replace(audit, notes=(few, *audit.notes))
    if not keeps_policy and audit.anchor == "answers":  # a mean of 1 over those that are not of the reference
        audit = replace(audit, step_weight=audit.step_weight / audit.step_weight.mean())
    return audit, (task, result)


def fit_task(task: Task, options: FitOptions, keeps_policy: bool = True) -> FitResult:
    """Decide which demonstrations of a task to trust, and fit the final policy if it is kept; the audit says how."""
    options.check(task)
    if keeps_policy and (task.answers.labels < 0).all():
        raise DataError(f"{task.source.source}: all demonstrations are labelled bad; leave one that may be good.")
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


def with_reference(demonstrations: Demonstrations, reference: Demonstrations) -> Demonstrations:
    """The `demonstrations`, and after them those of the `reference`; all ids are text, and no two are alike.

    A `DataError` where the two have other observations or actions.
    """
    one, other = demonstrations, reference
    missing = [name for name in one.observation_names if name not in other.observation_names]
    more = [name for name in other.observation_names if name not in one.observation_names]
    if missing or more:
        lacks = f"lacks {quoted(missing, 5)}" if missing else f"has {quoted(more, 5)} too"
        raise DataError(
            f"{other.source}: its observations are not those of {one.source}: it {lacks}; name the same ones with "
            "--observations or --exclude."
        )
    columns = [other.observation_names.index(name) for name in one.observation_names]
    kinds = [_kind_of_action(each) for each in (one, other)]
    if kinds[0] != kinds[1]:
        raise DataError(
            f"{other.source}: its actions are {kinds[1]}, and those of {one.source} are {kinds[0]}; give a reference "
            "with the same actions, or say what they are with --action or --action-kind."
        )
    prefixes = itertools.chain(["reference "], (f"reference {k} " for k in itertools.count(2)))
    prefix = next(p for p in prefixes if not any(str(name).startswith(p) for name in one.ids))
    return replace(
        one,
        observations=np.concatenate([one.observations, other.observations[:, columns]]),
        actions=np.concatenate([one.actions, other.actions]),
        offsets=np.concatenate([one.offsets, one.n_steps + other.offsets[1:]]),
        ids=(*map(str, one.ids), *(f"{prefix}{name}" for name in other.ids)),
    )


def _kind_of_action(demonstrations: Demonstrations) -> str:
    """A name for the kind of the actions, alike where they can be judged together."""
    if demonstrations.is_discrete:
        return "discrete text" if demonstrations.actions.dtype.kind == "U" else "discrete numbers"
    names = demonstrations.action_names
    return f"{demonstrations.n_actions} continuous numbers{f' ({quoted(names, 5)})' * bool(names)}"


JUDGE_FEATURES = "folded"
"""Features of the judge: no policy is kept, for which others would be chosen."""


def audit(
    data: StrPath | Frame | Demonstrations | Recording | Iterable[object],
    labels: Labels | StrPath | None = None,
    outcome: Names | Outcome | None = None,
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
    outcome : str or several, mapping of id to number, or sequence of M numbers, optional
        How each ended: a column, "length", a CSV file (id,value), or numbers. More is better; with a minus before the
        name less is better. A flag of 0 is bad unless others outweigh it. rpil learns how reliable each of several is.
    random_state : int
        Seed; the same seed gives the same bits.
    settings : Settings, optional
    progress : callable, optional
        Called with one line of text at every stage.
    **columns
        As for `rpil.read`, and ``operator`` (also a file, id,demonstrator), ``task`` and ``session``; see
        `rpil.open`.

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
    named = cast(Names, outcome) if outcome is not None and are_names(outcome) else ()
    options = replace(ColumnOptions(**columns), outcome=named)
    recording = opened(data, options)
    operator = options.operator if options.operator in options.files else None
    stated = Statements.of(recording, labels, operator, None if options.outcomes else outcome)
    path = data if isinstance(data, str | os.PathLike) else None
    given = {"labels": labels, "outcome": outcome, "random_state": random_state or None, **columns}
    texts = (f", {name}={value!r:.300}" for name, value in given.items() if value is not None)
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
    """The audit of a recording, within tasks and sessions; its `path`, `command` and other `files` say of what."""
    audit, _ = fit_within_tasks(recording, stated, options, keeps_policy=False)
    made = provenance_of(command, options.random_state, changed_settings(options.settings, Settings()), (path, *files))
    return replace(audit, provenance=made)
