"""`rpil.audit`: what the command ``rpil audit`` does, as a function."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Unpack, cast

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.facts import Outcome
from rpil.data.files import StrPath
from rpil.data.id_values import is_id_file
from rpil.estimators.rpil import RPIL
from rpil.estimators.settings import Settings
from rpil.estimators.task import Labels
from rpil.estimators.within_tasks import Known, judge_within_tasks
from rpil.formats import AuditOptions, read, read_recording
from rpil.formats.arrow import Frame, read_frame
from rpil.formats.columns import ColumnOptions, check_options
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
    labels : mapping of id to {"good", "bad", "better than ID", "same as ID"}, sequence of such pairs, or path, optional
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
    check_options(columns)
    operator = columns.get("operator")
    from_file = operator is not None and is_id_file(operator)
    options = replace(ColumnOptions(**columns), outcome=outcome if isinstance(outcome, str) else None)
    options = replace(options, operator=None) if from_file else options
    recording = _opened(data, options)
    known = Known.of(recording, labels, operator, None if isinstance(outcome, str) else outcome, None)

    def judge(demonstrations: Demonstrations | Dataset, own: Known) -> Audit:
        model = RPIL(
            AUDIT_FEATURES, adversary=AUDIT_ADVERSARY, random_state=random_state, settings=settings, progress=progress
        )
        return model.fit(demonstrations, labels=own.answers or None, **own.arguments).audit_

    found = judge_within_tasks(recording, known, judge)
    path = data if isinstance(data, str | os.PathLike) else None
    given = {"labels": labels, "outcome": outcome, "random_state": random_state or None, **columns}
    texts = (f", {name}={value!r:.300}" for name, value in given.items() if value is not None)
    call = f"rpil.audit({type(data).__name__ if path is None else repr(os.fspath(path))}{''.join(texts)})"
    files = labels if isinstance(labels, str | os.PathLike) else None, operator if from_file else None
    changed = changed_options(AUDIT_FEATURES, AUDIT_ADVERSARY, settings)
    made = Provenance.of(recording, path, call, random_state, changed, files)
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
