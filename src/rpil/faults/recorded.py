"""The rules about what is there at all: missing values, the recording's own times and lengths, and what formats find in
the files beside the demonstrations and in videos."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from rpil.data.arrays import Id
from rpil.data.demonstrations import BLOCK_STEPS, Block, DemonstrationSet, shard_bounds
from rpil.data.text import counted, duration, listed, moment
from rpil.faults import settings
from rpil.faults.measured_columns import all_values
from rpil.faults.motion import RepeatedFrames
from rpil.faults.rule import Fault, Rule
from rpil.faults.still import few
from rpil.formats.format import Defect
from rpil.formats.places import Times, usual_step
from rpil.numerics.types import Array


class MissingValues(Rule):
    name, words, grade = "missing values", "a value is NaN or infinite", "broken"

    @classmethod
    def find(cls, block: Block, ids: tuple[Id, ...], labels: tuple[str, ...], seconds: float | None) -> Iterator[Fault]:
        """Faults of each demonstration; `ids` are those of all the data, `labels` those of `column_labels`."""
        values = all_values(block)
        for m, (begin, end) in enumerate(itertools.pairwise(block.offsets)):
            steps, columns = np.nonzero(~np.isfinite(values[begin:end]))
            if len(steps):
                first, last, column = int(steps[0]), int(steps[-1]), int(columns[0])
                sentence = f"{labels[column]} is {values[begin + first, column]} at {moment(first, seconds)}"
                if len(steps) > 1:
                    sentence += f"; {counted(len(steps) - 1, 'more missing value')} up to {moment(last, seconds)}"
                name, n = ids[block.first + m], float(len(steps))
                yield Fault(cls.name, name, first, last, labels[column], n, 0.0, np.inf, sentence)


class FrameCount(Rule):
    name, words, grade = "frame count", "it has more or fewer steps than the recording says", "broken"

    @classmethod
    def find(cls, times: Times, demonstrations: DemonstrationSet) -> Iterator[Fault]:
        """Demonstrations with more or fewer frames than the recording says; all that are not there are one finding."""
        lengths = dict(zip(demonstrations.ids, demonstrations.lengths.tolist(), strict=True))
        for name, length in lengths.items():
            declared = times.frames.get(name, length)
            if declared != length:
                off = f"{declared - length:,} fewer" if declared > length else f"{length - declared:,} more"
                sentence = f"it has {counted(length, 'step')}, {off} than the {declared:,} that the recording says"
                yield Fault(cls.name, name, 0, length - 1, "", length, declared, 1.0 + abs(declared - length), sentence)
        if absent := [name for name in times.frames if name not in lengths]:
            steps = sum(times.frames[name] for name in absent)
            more = f"{counted(len(absent), 'more demonstration')} of {counted(steps, 'step')}"
            sentence = f"the recording names {more}, not in the data: {listed(absent)}"
            yield Fault(cls.name, "", 0, 0, "", 0, steps, 1.0 + steps, sentence)


class DroppedFrames(Rule):
    name, words = "dropped frames", "the time between two frames is too long"


class FrameRate(Rule):
    name, words = "frame rate", "its frames come at another rate"


def recorded_time(times: Times, demonstrations: DemonstrationSet) -> float | None:
    """Seconds between two frames by the timestamps; None where there are none, or all are coarser than the frames."""
    steps, tick = _steps(times, demonstrations)
    return None if tick else usual_step(steps)


def _steps(times: Times, demonstrations: DemonstrationSet) -> tuple[Array, float]:
    """Times between rows in each demonstration, or of very many rows in stretches, spread evenly; and the unit in which
    a clock counts that is coarser than the frames, as one of whole seconds, or 0."""
    inner, found, n = demonstrations.offsets[1:-1], [np.zeros(0)], demonstrations.n_steps
    for a in range(0, n, BLOCK_STEPS * -(-n // (16 * BLOCK_STEPS))):
        if times.timestamps is not None:
            between = inner[(inner > a) & (inner <= a + BLOCK_STEPS)] - a - 1
            found.append(np.delete(np.diff(times.timestamps[a : a + BLOCK_STEPS + 1]), between))
    steps = np.concatenate(found)
    later = steps[steps > 0]
    return steps, float(later.min()) if len(later) and np.median(steps) == 0 else 0.0


def find_frame_times(times: Times, demonstrations: DemonstrationSet, usual: float | None) -> Iterator[Fault]:
    """Times between two frames that are too long or too short, where `usual` seconds are usual; block by block."""
    if times.timestamps is None or usual is None:
        return
    limit, offsets = settings.FRAME_GAP + _steps(times, demonstrations)[1] / usual, demonstrations.offsets
    sums, late, early = list[Array](), list[Fault](), list[Fault]()
    for first, end in itertools.pairwise(shard_bounds(offsets, 1, BLOCK_STEPS)[0]):
        ids, begins = demonstrations.ids[first:end], offsets[first:end] - offsets[first]
        frames = np.diff(times.timestamps[offsets[first] : offsets[end]], prepend=0.0) / usual
        frames[begins] = 1.0
        lengths = demonstrations.lengths[first:end]
        shuffled = np.add.reduceat(frames < 0, begins) * settings.SHUFFLED >= lengths  # whose gaps are none
        in_order = np.where(np.repeat(shuffled, lengths), 1.0, frames)
        late += _wrong(DroppedFrames.name, in_order, limit, ids, begins, usual)
        early += _wrong(RepeatedFrames.name, frames, limit, ids, begins, usual)
        frames = np.where(np.abs(frames - 1.0) <= limit, frames, 1.0)
        frames[begins] = 0.0
        sums.append(np.add.reduceat(frames, begins))
    # A demonstration of one step tells no rate, and has the usual one.
    mean = (np.concatenate(sums) + (demonstrations.lengths == 1)) / np.maximum(demonstrations.lengths - 1, 1)
    yield from (*_find_rates(mean, limit, demonstrations, usual), *late, *early)


def _wrong(rule: str, frames: Array, limit: float, ids: Sequence[Id], begins: Array, usual: float) -> Iterator[Fault]:
    """Faults of the demonstrations of a block in which a time, in frames, is off by more than `limit`."""
    way = 1.0 if rule == DroppedFrames.name else -1.0
    off, threshold = way * (frames - 1.0), 1.0 + way * limit
    places = np.flatnonzero(~(off <= limit))  # a time that is missing is wrong as well
    owner = np.searchsorted(begins, places, side="right") - 1
    for m in np.unique(owner).tolist():
        wrong = places[owner == m]
        worst = int(wrong[np.argmax(np.nan_to_num(off[wrong], nan=np.inf))])
        step = worst - int(begins[m])
        lost = counted(int(np.rint(np.nan_to_num(off[wrong], posinf=0.0)).sum()), "frame")
        what = f"about {lost} missing" if rule == DroppedFrames.name else f"{counted(len(wrong), 'frame')} too soon"
        time, severity = 1e3 * usual * float(frames[worst]), float(np.nan_to_num(off[worst], nan=1e3)) / limit
        passed = f"{what}: {time:.4g} ms pass" if time < 1e4 else f"{what}: {time:,.0f} ms pass"
        if n_back := int((frames[wrong] < 0).sum()):
            far = duration(float(-frames[worst]), usual) if time < -10 else f"{-time:.2g} ms"
            passed = f"time goes back{f' {n_back} times, most' * (n_back > 1)} by {far}"
        said = "the time is missing" if np.isnan(time) else passed
        sentence = f"{said} before {moment(step, usual)} (usual: {'+' * (time < 0)}{1e3 * usual:.4g} ms)"
        yield Fault(rule, ids[m], step - 1, step, "", time, 1e3 * usual * threshold, severity, sentence)


def _find_rates(mean: Array, limit: float, demonstrations: DemonstrationSet, usual: float) -> Iterator[Fault]:
    """Demonstrations whose frames all come later, or sooner, than those of the others: by the mean of the times that
    are no gaps, which add up to more than `limit` frames."""
    lengths = demonstrations.lengths
    low, middle, high = np.quantile(mean, [0.25, 0.5, 0.75])
    off = np.abs(mean / middle - 1.0)
    least = np.maximum(settings.OTHER_RATE + settings.FENCE * (high - low), limit / np.maximum(lengths - 1, 1))
    found = np.flatnonzero((off > least) & (lengths > 1))
    if len(found) > few(len(lengths)):
        return
    for m in found.tolist():
        time, threshold = 1e3 * usual * mean[m], 1e3 * usual * middle
        sentence = f"a frame comes every {time:.4g} ms, and in the others every {threshold:.4g} ms"
        place = 0, int(lengths[m]) - 1, ""
        yield Fault(FrameRate.name, demonstrations.ids[m], *place, time, threshold, float(off[m] / least[m]), sentence)


def _rules(*lines: str) -> tuple[type[Rule], ...]:
    """A rule for each line of its name and its words."""
    words = (line.split(": ", 1) for line in lines)
    fields = ({"name": name, "words": text, "grade": "broken"} for name, text in words)
    return tuple(cast("type[Rule]", type("FolderRule", (Rule,), own)) for own in fields)


TIMESTAMPS = "timestamps"

OF_FILES = _rules(
    "totals: the folder declares more or fewer episodes or frames than the data have",
    "episode table: the table of episodes contradicts the data",
    "statistics: episodes_stats.jsonl, of version 2.1, is missing",
    "metadata: a file of the folder cannot be read",
    "missing episodes: episode numbers are missing",
    "named files: files that a column names are empty or missing",
)
OF_TIMES = _rules(
    f"{TIMESTAMPS}: the timestamps do not fit the declared frame rate",
    "video file: a video is missing or damaged",
    "video frames: a video has more or fewer frames than there are steps",
    "frame times: the frames of a video are at other times than the steps",
)
BY_LOOKING = _rules(  # what is seen only where videos are looked at
    "black frames: frames of a video are black",
    "frozen picture: a video shows one picture for long",
)

FOLDER_RULES = OF_FILES + OF_TIMES + BY_LOOKING


def find_beside(defects: Iterable[Defect], demonstrations: DemonstrationSet) -> list[Fault]:
    """Findings of formats, each about the demonstration that it names, or about none."""
    names, found = {str(name): m for m, name in enumerate(demonstrations.ids)}, []
    for one, m in ((one, names.get(one.place)) for one in defects):
        fault = fault_of(one)
        if m is not None:
            last = int(demonstrations.lengths[m]) - 1
            fault = replace(fault, id=demonstrations.ids[m], last=last, sentence=one.sentence)
        found.append(fault)
    return found


def fault_of(one: Defect) -> Fault:
    """A finding of a format, about no demonstration."""
    severity = 1.0 if one.what in {rule.name for rule in OF_FILES} else np.inf
    return Fault(one.what, "", 0, 0, "", 1.0, 0.0, severity, f"{one.place}: {one.sentence}")


def find_other_rate(times: Times, demonstrations: DemonstrationSet) -> Iterator[Fault]:
    """Timestamps of other frames a second than are declared: by the usual time between two frames, and by the median
    demonstration, for a clock may be coarse, and frames may be missing."""
    usual = recorded_time(times, demonstrations)
    if times.timestamps is None or not times.fps or not usual:
        return
    ends, steps = demonstrations.offsets[1:] - 1, demonstrations.lengths - 1
    lasts = times.timestamps[ends] - times.timestamps[demonstrations.offsets[:-1]]
    known = lasts > 0
    mean = lasts[known] / steps[known]
    off = np.abs(mean * times.fps - 1.0) - usual * times.fps / steps[known]  # a clock is as fine as its usual step
    if known.any() and min(abs(usual * times.fps - 1.0), np.median(off)) > settings.OTHER_RATE:
        rate = float(np.median(1.0 / mean))
        sentence = f"declared are {times.fps:.4g} frames a second; the timestamps say {rate:.4g}"
        yield Fault(TIMESTAMPS, "", 0, 0, "", rate, times.fps, np.inf, sentence)
