"""`rpil.audit`, what the command ``rpil audit`` does, as a function.

Nothing here needs scikit-learn, whose import takes longer than to judge a small file.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Unpack, cast

from rpil.data.demonstrations import Demonstrations
from rpil.data.files import StrPath
from rpil.data.recorded_facts import Outcome
from rpil.estimators.pipeline import FitOptions
from rpil.estimators.settings import Settings
from rpil.estimators.task import Labels, are_names
from rpil.estimators.within_tasks import Statements, fit_within_tasks
from rpil.formats import ReadOptions, opened
from rpil.formats.columns import ColumnOptions, Names, check_options
from rpil.formats.format import Frame
from rpil.formats.recording import Recording
from rpil.results.provenance import Provenance, changed_settings
from rpil.results.record import Audit

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
        name less is better. If all are 0 or 1, those with 0 are bad. rpil learns how reliable each of several is.
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
    """The audit of a recording, judged within tasks and sessions.

    The `path` of the recording, where it has one, the `command` and other `files` say where the audit comes from.
    """
    audit, _ = fit_within_tasks(recording, stated, options, keeps_policy=False)
    changed = changed_settings(options.settings, Settings())
    provenance = Provenance.of(command, options.random_state, changed, (path, *files))
    return replace(audit, provenance=provenance, fps=recording.description.fps or recording.times().fps)
