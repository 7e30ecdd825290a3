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


def _rules(words: Mapping[str, str]) -> tuple[type[Rule], ...]:
    """A rule for each name, with its words."""
    fields = ({"name": name, "words": text} for name, text in words.items())
    return tuple(cast("type[Rule]", type("FolderRule", (Rule,), own)) for own in fields)


TIMESTAMPS = "timestamps"

OF_FILES = _rules(
    {
        "totals": "the folder counts other episodes or frames than there are",
        "episode table": "the list of the episodes does not agree with the data",
        "statistics": "the statistics do not agree with the data, or are not there",
        "metadata": "a file of the folder cannot be understood",
    }
)
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
    *OF_FILES,
    *BY_LOOKING,
    *_rules(
        {
            TIMESTAMPS: "the times of the steps are not those of the frames a second that are declared",
            "video file": "a video is not there, or damaged",
            "video frames": "a video has more or fewer frames than there are steps",
            "frame times": "the frames of a video are at other times than the steps",
        }
    ),
)


def find_beside(defects: Iterable[Defect], demonstrations: DemonstrationSet) -> list[Fault]:
    """What formats found, each about the demonstration that it names, or about none."""
    names = {str(name): m for m, name in enumerate(demonstrations.ids)}
    light, found = {rule.name for rule in OF_FILES}, []
    for one in defects:
        m = names.get(one.place)
        last = 0 if m is None else int(demonstrations.lengths[m]) - 1
        sentence = f"{one.place}: {one.sentence}" if m is None else one.sentence
        place = "" if m is None else demonstrations.ids[m], 0, last
        found.append(Fault(one.what, *place, "", 1.0, 0.0, 1.0 if one.what in light else np.inf, sentence))
    return found


def find_other_rate(times: Times, demonstrations: DemonstrationSet) -> Iterator[Fault]:
    """Timestamps of other frames a second than are declared: by the usual time between two frames, and by the median
    demonstration, for a clock may be coarse, and frames may be missing."""
    usual = recorded_time(times, demonstrations)
    if times.timestamps is None or not times.fps or not usual:
        return
    ends, steps = demonstrations.offsets[1:] - 1, demonstrations.lengths - 1
    lasts = times.timestamps[ends] - times.timestamps[demonstrations.offsets[:-1]]
    known = (steps > 0) & (lasts > 0)
    mean = lasts[known] / steps[known]
    off = np.abs(mean * times.fps - 1.0) - usual * times.fps / steps[known]  # a clock is as fine as its usual step
    if known.any() and min(abs(usual * times.fps - 1.0), np.median(off)) > OTHER_RATE:
        rate = float(np.median(1.0 / mean))
        sentence = f"declared are {times.fps:.4g} frames a second; the timestamps say {rate:.4g}"
        yield Fault(TIMESTAMPS, "", 0, 0, "", rate, times.fps, np.inf, sentence)
