"""`rpil.audit`: what the command ``rpil audit`` does, as a function."""

from __future__ import annotations

import os
import reprlib
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import chain
from typing import Unpack, cast

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.facts import Outcome
from rpil.data.files import StrPath
from rpil.data.id_values import better_than, check_ids, is_id_file
from rpil.estimators.rpil import RPIL
from rpil.estimators.settings import Settings
from rpil.estimators.task import Labels
from rpil.estimators.within_tasks import Known, judge_within_tasks
from rpil.formats import AuditOptions, read, read_answers, read_demonstrators, read_recording
from rpil.formats.arrow import Frame, read_frame
from rpil.formats.columns import ColumnOptions
from rpil.formats.dataset import Dataset
from rpil.formats.recording import Recording, from_demonstrations
from rpil.results.provenance import Provenance, changed_settings
from rpil.results.record import Audit

AUDIT_FEATURES, AUDIT_ADVERSARY = "folded", "auto"
"""Those of an audit, of which no policy is kept."""


def audit(
    data: StrPath | Frame | Demonstrations | Recording | Iterable[object],
    labels: Labels | StrPath | None = None,
    outcome: str | Outcome | None = None,
    *,
    random_state: int = 0,
    settings: Settings | None = None,
    progress: Callable[[str], None] | None = None,
    **columns: Unpack[AuditOptions],
) -> Audit:
    """Judge how far each demonstration can be trusted, within its task and session, as ``rpil audit`` does.

    Parameters
    ----------
    data : path, frame, Demonstrations, Recording or iterable of trajectories
        As for `rpil.read`; large files stay on disk.
    labels : mapping of id to {"good", "bad", "better than ID"}, sequence of such pairs, or path, optional
        Answers about demonstrations; of a CSV file (id,label) or JSON where it is a path.
    outcome : str, mapping of id to number, or sequence of M numbers, optional
        How each demonstration ended: a column, "length", or numbers, of which more is better; in the name of a column
        a minus before it says that more is worse.
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
    operator = columns.get("operator")
    from_file = operator is not None and is_id_file(operator)
    options = replace(ColumnOptions(**columns), outcome=outcome if isinstance(outcome, str) else None)
    options = replace(options, operator=None) if from_file else options
    recording = _opened(data, options)
    words = _read_words(labels, recording) if isinstance(labels, str | os.PathLike) else labels
    who = _read_operators(str(operator), recording) if from_file else None
    known = Known.of(recording, words or None, who, None if isinstance(outcome, str) else outcome, None)

    def judge(demonstrations: Demonstrations | Dataset, own: Known) -> Audit:
        model = RPIL(
            AUDIT_FEATURES, adversary=AUDIT_ADVERSARY, random_state=random_state, settings=settings, progress=progress
        )
        return model.fit(demonstrations, labels=own.answers or None, **own.arguments).audit_

    found = judge_within_tasks(recording, known, judge)
    answers = {"labels": labels, "outcome": outcome}
    given = {name: repr(value) for name, value in ({"random_state": random_state or None} | columns).items() if value}
    given = {name: reprlib.repr(value) for name, value in answers.items() if value is not None} | given
    path = data if isinstance(data, str | os.PathLike) else None
    call = ", ".join(
        [
            type(data).__name__ if path is None else repr(os.fspath(path)),
            *(f"{name}={text}" for name, text in given.items()),
        ]
    )
    files = labels if isinstance(labels, str | os.PathLike) else None, operator if from_file else None
    changed = changed_options(AUDIT_FEATURES, AUDIT_ADVERSARY, settings)
    made = Provenance.of(recording, path, f"rpil.audit({call})", random_state, changed, files)
    return replace(found, provenance=made)


def changed_options(features: str, adversary: str, settings: Settings | None) -> dict[str, object]:
    """The settings of an audit that are not the defaults, by their names with dots."""
    own = {"features": (features, AUDIT_FEATURES), "adversary": (adversary, AUDIT_ADVERSARY)}
    changed: dict[str, object] = {name: given for name, (given, default) in own.items() if given != default}
    return changed | changed_settings(settings or Settings(), Settings())


def _opened(data: object, options: ColumnOptions) -> Recording:
    """The recording in the data; a `DataError` where they have no columns to choose."""
    if isinstance(data, Frame):
        return read_frame(data, options)
    if isinstance(data, str | os.PathLike):
        return read_recording(data, options, on_disk=None)
    if options != ColumnOptions():
        raise DataError(f"{type(data).__name__} has no columns to choose: name them where it is read.")
    if isinstance(data, Recording):
        return data
    demonstrations = data if isinstance(data, Demonstrations) else read(cast("Iterable[object]", data))
    return from_demonstrations(demonstrations, "demonstrations in memory")


def _read_words(path: StrPath, recording: Recording) -> list[tuple[str, str]]:
    """The answers in a file as ids and words, without those about demonstrations that were left out of the data."""
    labels, pairs = read_answers(path)
    own = _own_ids([*labels, *chain.from_iterable(pairs)], recording, str(path), "the labels")
    words = [(better, better_than(worse)) for better, worse in pairs if {better, worse} <= own]
    return [*((m, label) for m, label in labels.items() if m in own), *words]


def _read_operators(path: str, recording: Recording) -> dict[str, str]:
    """The demonstrators in a file, by ids; as `_read_words`."""
    operators = read_demonstrators(path, recording)
    own = _own_ids(operators, recording, path, "the demonstrators")
    return {m: name for m, name in operators.items() if m in own}


def _own_ids(names: Iterable[str], recording: Recording, path: str, what: str) -> set[str]:
    """The ids of a recording; a `DataError` where a file `names` others than those and the ones that were left out."""
    ids = recording.demonstrations.ids
    check_ids(names, recording.ids or ids, path, what)
    return {*map(str, ids)}
