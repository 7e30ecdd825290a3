"""Recordings that can be asked for their faults: what `rpil.open` gives.

`Recording` itself cannot be asked, because the formats come before the faults, and know nothing of them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
from typing import Unpack

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.missing import allow_missing, fill_chunks
from rpil.faults.check import find_faults
from rpil.faults.record import FaultReport
from rpil.faults.settings import FaultSettings
from rpil.formats import OpenOptions, read_recording
from rpil.formats.arrow import Frame, read_frame
from rpil.formats.columns import ColumnOptions, check_options
from rpil.formats.dataset import Dataset
from rpil.formats.recording import Recording


def faults_of(
    recording: Recording,
    fps: float | None,
    expected: Mapping[str, Collection[str]] | None,
    skip_bad: bool,
    settings: FaultSettings,
) -> FaultReport:
    """The faults of a recording; `fps` are the frames a second where the recording does not say."""
    times = recording.times()
    stated = replace(times, fps=fps or recording.description.fps or times.fps)
    return find_faults(_with_missing(recording), stated, expected, skip_bad, settings)


def _with_missing(recording: Recording) -> Demonstrations | Dataset:
    """The demonstrations, where some values may be missing: these are reported, and not learned from later."""
    try:
        return recording.demonstrations
    except DataError:
        with allow_missing():
            return recording.load()


@dataclass(frozen=True, eq=False, repr=False)
class OpenedRecording(Recording):
    """A `Recording` that can be asked for its faults."""

    def faults(
        self,
        *,
        fps: float | None = None,
        expected: Mapping[str, Collection[str]] | None = None,
        skip_bad: bool = False,
        settings: FaultSettings | None = None,
    ) -> FaultReport:
        """The recording faults, as ``rpil check`` finds them.

        Parameters
        ----------
        fps : float, optional
            Frames a second, where the recording does not say.
        expected : mapping of rule to ids, optional
            Findings that are declared expected; they are counted and left out.
        skip_bad : bool
            Set demonstrations with missing values aside and check the others.
        settings : FaultSettings, optional

        Returns
        -------
        FaultReport
        """
        return faults_of(self, fps, expected, skip_bad, settings or FaultSettings())


def open(
    path: StrPath | Frame, *, on_disk: bool | None = None, fill_missing: bool = False, **columns: Unpack[OpenOptions]
) -> OpenedRecording:
    """Open a recording once, and ask everything of it.

    Its methods are what the commands do: ``describe()`` is ``rpil info``, ``faults()`` is ``rpil check``,
    ``keep(ids, output)`` is ``rpil keep``, and ``RPIL().fit(recording).audit_`` is ``rpil audit``.

    Parameters
    ----------
    path : path or frame
        A file or folder of any known format, a pattern, an address, or a data frame.
    on_disk : bool, optional
        Leave the demonstrations, in Parquet files, on disk, or read them into memory; by default large files and
        folders of Parquet files stay there.
    fill_missing : bool
        As for `rpil.read`.
    **columns
        As for `rpil.read`, and ``operator``, ``task``, ``session``, ``outcome``: see `ColumnOptions`.

    Returns
    -------
    Recording
        With ``description``, ``demonstrations``, ``tasks``, ``operators`` and ``facts``.

    Raises
    ------
    DataError
        One sentence naming the file and the remedy. A value that is missing, or of the wrong kind, is an error only
        where the demonstrations are asked for.

    Examples
    --------
    >>> recording = rpil.open("drive.parquet")        # doctest: +SKIP
    >>> recording.faults().counts                     # doctest: +SKIP
    >>> audit = rpil.RPIL().fit(recording).audit_     # doctest: +SKIP
    """
    check_options(columns)
    options = ColumnOptions(**columns)
    with fill_chunks(fill_missing):
        found = read_frame(path, options) if isinstance(path, Frame) else read_recording(path, options, on_disk=on_disk)
    values = {field.name: getattr(found, field.name) for field in fields(found)}
    return OpenedRecording(**values | {"options": options})
