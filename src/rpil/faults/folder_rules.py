"""The rules about the files beside the demonstrations, and about videos: formats look, and these name it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import cast

import numpy as np

from rpil.data.demonstrations import DemonstrationSet
from rpil.faults.recorded import OTHER_RATE, recorded_time
from rpil.faults.rule import Fault, Rule
from rpil.formats.format import Defect
from rpil.formats.times import Times


class FolderRule(Rule):
    """The files beside the demonstrations, or a video, do not agree with these."""

    severity = np.inf


def _rules(words: Mapping[str, str], severity: float = np.inf) -> tuple[type[FolderRule], ...]:
    """A rule for each name."""
    fields = ({"name": name, "words": text, "severity": severity} for name, text in words.items())
    return tuple(cast("type[FolderRule]", type("FolderRule", (FolderRule,), own)) for own in fields)


TIMESTAMPS = "timestamps"

BY_LOOKING = _rules(
    {
        "black frames": "frames of a video are black",
        "frozen picture": "the picture of a video stays the same for long",
        "repeated pictures": "many frames of a video repeat the one before while others move",
        "exchanged cameras": "two cameras show each what the other shows elsewhere",
    }
)
"""What is seen only where videos are looked at."""

FOLDER_RULES = (
    *_rules(
        {
            TIMESTAMPS: "the times of the steps are not those of the frames a second that are declared",
            "video file": "a video is not there, or damaged",
            "video frames": "a video has more or fewer frames than there are steps",
            "frame times": "the frames of a video are at other times than the steps",
        }
    ),
    *BY_LOOKING,
    *_rules(
        {
            "metadata": "a file of the folder cannot be understood",
            "totals": "the folder counts other episodes or frames than there are",
            "episode table": "the list of the episodes does not agree with the data",
            "statistics": "the statistics do not agree with the data, or are not there",
        },
        severity=1.0,
    ),
)


def find_beside(defects: Iterable[Defect], demonstrations: DemonstrationSet) -> list[Fault]:
    """What formats found, each about the demonstration that it names, or about none."""
    names = {str(name): m for m, name in enumerate(demonstrations.ids)}
    severities, found = {rule.name: rule.severity for rule in FOLDER_RULES}, []
    for one in defects:
        m = names.get(one.place)
        last = 0 if m is None else int(demonstrations.lengths[m]) - 1
        sentence = f"{one.place}: {one.sentence}" if m is None else one.sentence
        place = "" if m is None else demonstrations.ids[m], 0, last
        found.append(Fault(one.what, *place, "", 1.0, 0.0, severities.get(one.what, np.inf), sentence))
    return found


def find_other_rate(times: Times, demonstrations: DemonstrationSet) -> Iterator[Fault]:
    """Timestamps of other frames a second than are declared: by the usual time between two frames, and by the median
    demonstration, for a clock may be coarse, and frames may be missing."""
    declared, stamps, usual = times.fps, times.timestamps, recorded_time(times, demonstrations)
    if stamps is None or not declared or not usual:
        return
    steps = demonstrations.lengths - 1
    lasts = stamps[demonstrations.offsets[1:] - 1] - stamps[demonstrations.offsets[:-1]]
    known = (steps > 0) & (lasts > 0)
    if not known.any() or abs(usual * declared - 1.0) <= OTHER_RATE:
        return
    steps, lasts = steps[known], lasts[known]
    off = np.abs(lasts * declared / steps - 1.0) - usual * declared / steps  # a clock is as fine as its usual step
    if np.median(off) > OTHER_RATE:
        rate = float(np.median(steps / lasts))
        sentence = f"declared are {declared:.4g} frames a second; the timestamps say {rate:.4g}"
        yield Fault(TIMESTAMPS, "", 0, 0, "", rate, declared, np.inf, sentence)
