"""The rules about the files beside the demonstrations, and about videos: formats look, and these name it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from rpil.data.demonstrations import DemonstrationSet
from rpil.faults.recorded import recorded_time
from rpil.faults.rule import Fault, Rule
from rpil.formats.format import Defect
from rpil.formats.times import Times

OTHER_RATE = 0.01
"""Share by which frames a second may differ from those that are declared."""


class FolderRule(Rule):
    """The files beside the demonstrations, or a video, do not agree with these."""

    severity = np.inf


class Timestamps(FolderRule):
    name, words = "timestamps", "the times of the steps are not those of the frames a second that are declared"


class VideoFile(FolderRule):
    name, words = "video file", "a video is not there, or damaged"


class VideoFrames(FolderRule):
    name, words = "video frames", "a video has more or fewer frames than there are steps"


class FrameTimes(FolderRule):
    name, words = "frame times", "the frames of a video are at other times than the steps"


class BadMetadata(FolderRule):
    name, words, severity = "metadata", "a file of the folder cannot be understood", 1.0


class Totals(FolderRule):
    name, words, severity = "totals", "the folder counts other episodes or frames than there are", 1.0


class EpisodeTable(FolderRule):
    name, words, severity = "episode table", "the list of the episodes does not agree with the data", 1.0


class Statistics(FolderRule):
    name, words, severity = "statistics", "the statistics do not agree with the data, or are not there", 1.0


class BlackFrames(FolderRule):
    name, words = "black frames", "frames of a video are black"


class FrozenPicture(FolderRule):
    name, words = "frozen picture", "the picture of a video stays the same for long"


class RepeatedPictures(FolderRule):
    name, words = "repeated pictures", "many frames of a video repeat the one before while others move"


class ExchangedCameras(FolderRule):
    name, words = "exchanged cameras", "two cameras show each what the other shows elsewhere"


class TurnedCamera(FolderRule):
    name, words = "turned camera", "the picture of a video is upside down or mirrored"


class VideoTime(FolderRule):
    name, words = "video time", "the picture of a video moves earlier or later than the joints"


class OtherVideo(FolderRule):
    name, words = "other video", "a video moves as the joints of another episode, or with none"


BY_LOOKING = (
    BlackFrames,
    FrozenPicture,
    RepeatedPictures,
    ExchangedCameras,
    TurnedCamera,
    VideoTime,
    OtherVideo,
)
"""What is seen only where videos are looked at."""

FOLDER_RULES = (
    Timestamps,
    VideoFile,
    VideoFrames,
    FrameTimes,
    *BY_LOOKING,
    BadMetadata,
    Totals,
    EpisodeTable,
    Statistics,
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
        yield Fault(Timestamps.name, "", 0, 0, "", rate, declared, np.inf, sentence)
