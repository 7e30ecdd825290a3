"""Times between frames and numbers of frames."""

from __future__ import annotations

import numpy as np

from recordings import changed, demonstrations, recording
from rpil.faults.checking import check
from rpil.formats.metadata import Times

CLEAN = demonstrations(recording(5))


def times(drop=()):
    """Timestamps at 50 frames a second, without those at the (demonstration, step, frames) of `drop`."""
    each = [np.arange(length) / 50 for length in CLEAN.lengths]
    for m, step, frames in drop:
        each[m][step:] += frames / 50
    return np.concatenate(each)


def test_the_frame_rate_of_the_user_comes_before_that_of_the_times():
    stamps = times([(2, 30, 3), (4, 10, 1)])
    reports = [check(CLEAN, times=Times(stamps, fps), fps=100.0) for fps in (50.0, None)]
    assert {report.usual["dropped frames"] for report in reports} == {
        check(CLEAN, times=Times(stamps, 100.0)).usual["dropped frames"]
    }
    assert "10 ms" in reports[0].usual["dropped frames"]


def test_the_worst_of_repeated_rows_and_times_is_the_finding():
    episodes = recording(5)
    rows = np.insert(np.arange(len(episodes[2][0])), 70, [70] * 9)
    observations, actions = (values[rows] for values in episodes[2])
    repeated = demonstrations(changed(episodes, 2, observations=observations, actions=actions))
    stamps = np.concatenate([np.arange(length) / 50 for length in repeated.lengths])
    stamps[repeated.offsets[2] + 30 : repeated.offsets[3]] -= 0.75 / 50
    (fault,) = [f for f in check(repeated, times=Times(stamps)).findings if f.rule == "repeated frames"]
    assert (fault.first, fault.last, round(fault.severity, 9)) == (71, 79, 3)


def test_a_clock_of_whole_seconds_tells_gaps_of_seconds_alone():
    whole = np.floor(times())
    assert not check(CLEAN, times=Times(whole, 50.0)).findings
    report = check(CLEAN, times=Times(np.floor(times([(2, 30, 150)])), 50.0))
    assert [(f.rule, f.id) for f in report.findings] == [("dropped frames", 2)]
    assert "coarser" in check(CLEAN, times=Times(whole)).not_checked["dropped frames"]
