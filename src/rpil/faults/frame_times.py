"""Faults that the recording's own times and lengths show."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rpil.data.demonstrations import DemonstrationSet
from rpil.faults.report import Fault
from rpil.faults.settings import FaultSettings
from rpil.formats.times import Times, usual_step
from rpil.numerics.types import Array


def frame_time(times: Times, demonstrations: DemonstrationSet) -> float | None:
    """Seconds between two frames: by the frame rate, else the usual time between two steps; None if unknown."""
    return 1.0 / times.fps if times.fps else recorded_time(times, demonstrations)


def recorded_time(times: Times, demonstrations: DemonstrationSet) -> float | None:
    """Seconds between two frames by the timestamps; None where there are none."""
    return None if times.timestamps is None else usual_step(np.diff(times.timestamps)[_within(demonstrations)])


def _within(demonstrations: DemonstrationSet) -> Array:
    """Whether a step and the one before are of the same demonstration, (N - 1,)."""
    inside = np.ones(demonstrations.n_steps - 1, dtype=bool)
    inside[demonstrations.offsets[1:-1] - 1] = False
    return inside


def find_frame_times(times: Times, demonstrations: DemonstrationSet, settings: FaultSettings) -> Iterator[Fault]:
    """Times between two frames that are too long or too short."""
    usual = frame_time(times, demonstrations)
    if times.timestamps is None or usual is None:
        return
    frames = np.where(_within(demonstrations), np.diff(times.timestamps), usual) / usual
    for rule, off, limit in (
        ("dropped frames", frames - 1.0, settings.frame_gap),
        ("repeated frames", 1.0 - frames, settings.frame_gap),
    ):
        places = np.flatnonzero(~(off <= limit))  # a time that is missing is wrong as well
        owner = np.searchsorted(demonstrations.offsets, places + 1, side="right") - 1
        for m in np.unique(owner).tolist():
            own = places[owner == m]
            worst = int(own[np.argmax(np.nan_to_num(off[own], nan=np.inf))])
            step = worst + 1 - int(demonstrations.offsets[m])
            lost = int(np.rint(np.nan_to_num(off[own], posinf=0.0)).sum())
            what = (
                f"about {lost} frames are missing" if rule == "dropped frames" else f"{len(own)} frames come too soon"
            )
            sentence = f"{what}, the worst at step {step}: {1e3 * usual * frames[worst]:.4g} ms after the one before"
            yield Fault(
                rule,
                demonstrations.ids[m],
                step - 1,
                step,
                "",
                1e3 * usual * float(frames[worst]),
                1e3 * usual * (1.0 + limit if rule == "dropped frames" else 1.0 - limit),
                float(np.nan_to_num(off[worst], nan=1e3)) / limit,
                f"{sentence} ({1e3 * usual:.4g} ms is usual)",
            )


def find_frame_counts(times: Times, demonstrations: DemonstrationSet) -> Iterator[Fault]:
    """Demonstrations with more or fewer frames than the recording says, and those that are not there at all."""
    for name, length in zip(demonstrations.ids, demonstrations.lengths.tolist(), strict=True):
        declared = times.frames.get(name, length)
        if declared != length:
            kind = f"{declared - length} are missing" if declared > length else f"{length - declared} are too many"
            sentence = f"it has {length} frames, and the recording says {declared}: {kind}"
            severity = 1.0 + abs(declared - length)
            yield Fault("frame count", name, 0, length - 1, "", length, declared, severity, sentence)
    for name in times.frames.keys() - set(demonstrations.ids):
        sentence = f"it is not in the data, and the recording says it has {times.frames[name]} frames"
        yield Fault("frame count", name, 0, 0, "", 0, times.frames[name], 1.0 + times.frames[name], sentence)
