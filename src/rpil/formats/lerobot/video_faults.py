"""Faults of LeRobot's videos: files, numbers of frames, and pictures: black or frozen."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from rpil.data.errors import DataError
from rpil.data.text import duration
from rpil.formats.format import Defect, Shot
from rpil.formats.lerobot import video
from rpil.formats.lerobot.checked_folder import NEAR_SECONDS
from rpil.numerics.types import Array

DARK = 32  # brightness, of 0 to 255, that no pixel of a black frame exceeds
SAME_MEAN, SAME_MOST = 0.5, 8  # change of brightness, of all pixels and of one, below which a frame repeats the other
LEAST_SAME = 0.8  # of the frames of a run, that repeat the one before
FROZEN_SECONDS = 1.0  # for which a picture may stay the same
REST = 0.05  # of the range of a joint: less is no motion
TIMES_USUAL = 3.0  # by which an episode must exceed the upper quartile of the others
LEAST_EPISODES = 4  # to know what is usual


def find_faults(shots: Sequence[Shot], fps: float, states: Mapping[int, Array] | None = None) -> Iterator[Defect]:
    """Videos that are not there, or damaged, and episodes with more or fewer frames than rows.

    With the `states` of the episodes, (N, D) each, also faults of the pictures.
    """
    by_file = defaultdict[Path, list[Shot]](list)
    for shot in shots:
        by_file[shot.path].append(shot)
    lost = {path for path in by_file if not path.is_file()}
    still = defaultdict[str, dict[int, tuple[int, int]]](dict)
    for camera in sorted({shot.camera for shot in shots}):
        paths = dict.fromkeys(shot.path for shot in shots if shot.camera == camera)
        if missing := [path for path in paths if path in lost]:
            said = f"{len(missing)} of {len(paths)} files are not there, the first is {missing[0]}"
            yield Defect("video file", camera, said)
    for path in [path for path in by_file if path not in lost]:
        own = by_file[path]
        try:
            times, frames = (video.Packets.of(path).times, None) if states is None else video.look(path)
        except DataError as error:
            first, last = own[0].episode, own[-1].episode
            yield Defect("video file", str(first) if first == last else f"{first} to {last}", str(error).rstrip("."))
            continue
        for shot in own:
            inside = (times >= shot.start - 0.5 / fps) & (times < shot.end - 0.5 / fps)
            yield from _of_times(shot, np.sort(times[inside]), fps)
            if frames is not None and inside.any():
                is_black = frames[inside].max(axis=(1, 2)) <= DARK
                yield from _black(shot, is_black, fps)
                if not is_black.all():
                    still[shot.camera][shot.episode] = _stillness(frames[inside], is_black)
    for camera, of_episode in still.items():
        yield from _unchanged(camera, of_episode, fps, states or {})


def _black(shot: Shot, is_black: Array, fps: float) -> Iterator[Defect]:
    """The frames of an episode that are black, (F,)."""
    if is_black.any():
        black = np.flatnonzero(is_black)
        said = f"is black in {len(black)} frames of {len(is_black)}, from {duration(black[0], 1 / fps)}"
        yield Defect("black frames", str(shot.episode), f"{shot.camera} {said}")


def _of_times(shot: Shot, times: Array, fps: float) -> Iterator[Defect]:
    """More or fewer frames than rows, or frames at other times."""
    n, name = len(times), str(shot.episode)
    if n != shot.n_rows:
        yield Defect("video frames", name, f"{shot.camera} has {n} frames for {shot.n_rows} rows")
    elif (off := np.abs(times - shot.start - np.arange(n) / fps).max()) > NEAR_SECONDS:
        said = f"LeRobot cannot load it, for {shot.camera} is up to {off:.3g} s off {fps:.3g} frames a second"
        yield Defect("frame times", name, f"{said}; correct from_timestamp, or write the video again")


def _stillness(seen: Array, is_black: Array) -> tuple[int, int]:
    """The longest run of frames that repeat the one before, and its first.

    A codec refines a picture that stays, and renews it at key frames: a few such changes between repeats end no run.
    """
    change = np.abs(np.diff(seen.astype(np.int16), axis=0))
    mean, most = change.mean(axis=(1, 2)), change.max(axis=(1, 2))
    same = (mean <= SAME_MEAN) & (most <= SAME_MOST) & ~is_black[1:]
    small = (mean <= 2 * SAME_MEAN) & (most <= 4 * SAME_MOST)
    moves = (mean > 8 * SAME_MEAN) | (most > 4 * SAME_MOST)
    first = length = 0
    for repeats in (same | (small & (np.convolve(same, [1, 0, 1], "same") == 2)), same):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], repeats, [False]])))
        lengths = np.diff(edges)[::2]
        if len(lengths):
            first, length = int(edges[::2][np.argmax(lengths)]), int(lengths.max())
            if same[first : first + length].mean() >= LEAST_SAME:
                break
    if length and moves.any():  # what comes before it is the same picture, if it differs by less than moving ones do
        off = np.abs(seen[:first].astype(float) - seen[first]).mean(axis=(1, 2)) > 0.5 * np.median(mean[moves])
        before = first - int(np.flatnonzero(np.append(True, off))[-1])
        first, length = first - before, length + before
    return length, first


def _unchanged(
    camera: str, of_episode: Mapping[int, tuple[int, int]], fps: float, states: Mapping[int, Array]
) -> Iterator[Defect]:
    """Frozen frames of a camera, beyond what is usual in it.

    A picture may stay while the joints, of which the `states` are, do not move either.
    """
    runs, firsts = (np.array(values) for values in zip(*of_episode.values(), strict=True))
    usual = TIMES_USUAL * np.quantile(runs, 0.75)
    for k, episode in enumerate(of_episode if len(runs) >= LEAST_EPISODES else ()):
        state = states.get(episode, np.zeros((0, 1)))
        part = state[firsts[k] : firsts[k] + runs[k]]
        rests = len(part) > 0 and (np.ptp(part, axis=0) <= REST * np.ptp(state, axis=0)).all()
        if runs[k] >= FROZEN_SECONDS * fps and runs[k] > usual and not rests:
            words = f"shows one picture for {duration(runs[k], 1 / fps)} from {duration(firsts[k], 1 / fps)} on"
            yield Defect("frozen picture", str(episode), f"{camera} {words}")
