"""Faults of LeRobot's videos: files, numbers of frames, and pictures that are black, frozen, repeated or exchanged."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from rpil.data.errors import DataError
from rpil.formats.format import Defect, Shot
from rpil.formats.lerobot import video
from rpil.formats.lerobot.checked_folder import NEAR_SECONDS
from rpil.numerics.types import Array

DARK = 32  # brightness, of 0 to 255, that no pixel of a black frame exceeds
SAME_MEAN, SAME_MOST = 0.5, 8  # change of brightness, of all pixels and of one, below which a frame repeats the other
FROZEN_SECONDS = 1.0  # for which a picture may stay the same
REPEATED_SHARE = 0.3  # of the frames of an episode
TIMES_USUAL = 3.0  # by which an episode must exceed the upper quartile of the others
LEAST_EPISODES = 4  # to know what is usual


def find_faults(shots: Sequence[Shot], fps: float, look: bool) -> Iterator[Defect]:
    """Videos that are not there, or damaged, and episodes with more or fewer frames than rows.

    Where videos are to be looked at, also black, frozen and repeated frames, and exchanged cameras.
    """
    pictures: dict[tuple[str, int], Array] = {}
    still: dict[str, dict[int, tuple[int, int, float]]] = defaultdict(dict)
    by_file = defaultdict[Path, list[Shot]](list)
    for shot in shots:
        by_file[shot.path].append(shot)
    lost = {path for path in by_file if not path.is_file()}
    for camera in sorted({shot.camera for shot in shots}):
        paths = dict.fromkeys(shot.path for shot in shots if shot.camera == camera)
        if missing := [path for path in paths if path in lost]:
            said = f"{len(missing)} of {len(paths)} files are not there, the first is {missing[0]}"
            yield Defect("video file", camera, said)
    for path in [path for path in by_file if path not in lost]:
        own = by_file[path]
        try:
            times = video.Packets.of(path).times
            times, frames = video.look(path) if look else (times, np.empty((len(times), 0)))
        except DataError as error:
            first, last = own[0].episode, own[-1].episode
            yield Defect("video file", str(first) if first == last else f"{first} to {last}", str(error).rstrip("."))
            continue
        for shot in own:
            inside = (times >= shot.start - 0.5 / fps) & (times < shot.end - 0.5 / fps)
            yield from _of_times(shot, np.sort(times[inside]), fps)
            seen, n, name = frames[inside], int(inside.sum()), str(shot.episode)
            if seen.size:
                black = np.flatnonzero(seen.max(axis=1) <= DARK)
                if len(black) < n:
                    pictures[shot.camera, shot.episode] = seen.mean(axis=0)
                    still[shot.camera][shot.episode] = _stillness(seen)
                if len(black):
                    said = f"{shot.camera} is black in {len(black)} frames of {n}, from {black[0]}"
                    yield Defect("black frames", name, said)
    for camera, of_episode in still.items():
        yield from _unchanged(camera, of_episode, fps)
    yield from _exchanged(pictures)


def _of_times(shot: Shot, times: Array, fps: float) -> Iterator[Defect]:
    """More or fewer frames than rows, or frames at other times."""
    n, name = len(times), str(shot.episode)
    if n != shot.n_rows:
        yield Defect("video frames", name, f"{shot.camera} has {n} frames for {shot.n_rows} rows")
    elif (off := np.abs(times - shot.start - np.arange(n) / fps).max()) > NEAR_SECONDS:
        said = f"LeRobot cannot load it, for {shot.camera} is up to {off:.3g} s off {fps:.3g} frames a second"
        yield Defect("frame times", name, f"{said}; correct from_timestamp, or write the video again")


def _stillness(seen: Array) -> tuple[int, int, float]:
    """The longest run of frames that repeat the one before, its first, and the share of repeats while all moves."""
    change = np.abs(np.diff(seen.astype(np.int16), axis=0))
    same = (change.mean(axis=1) <= SAME_MEAN) & (change.max(axis=1) <= SAME_MOST)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]])))
    runs, lengths = edges[::2], np.diff(edges)[::2]
    longest = int(np.argmax(lengths)) if len(runs) else 0
    single = int((lengths == 1).sum())
    return (int(lengths[longest]), int(runs[longest]) + 1, single / len(seen)) if len(runs) else (0, 0, 0.0)


def _unchanged(camera: str, of_episode: Mapping[int, tuple[int, int, float]], fps: float) -> Iterator[Defect]:
    """Frozen and repeated frames of a camera: beyond what is usual in it, or beyond a share of an episode."""
    runs, firsts, shares = (np.array(values) for values in zip(*of_episode.values(), strict=True))
    usual = TIMES_USUAL * np.quantile([runs, shares], 0.75, axis=1)
    known = len(runs) >= LEAST_EPISODES
    for k, episode in enumerate(of_episode):
        if runs[k] >= FROZEN_SECONDS * fps and known and runs[k] > usual[0]:
            words = f"{camera} shows one picture for {runs[k] / fps:.1f} s from frame {firsts[k]}"
            yield Defect("frozen picture", str(episode), words)
        elif shares[k] >= REPEATED_SHARE and known and shares[k] > usual[1]:
            words = f"{camera} repeats {shares[k]:.0%} of its frames while all moves"
            yield Defect("repeated pictures", str(episode), words)
    if np.median(shares) >= REPEATED_SHARE:
        slow = f"{camera} repeats {np.median(shares):.0%} of its frames: it is slower than data"
        yield Defect("repeated pictures", "all", slow)


def _exchanged(pictures: Mapping[tuple[str, int], Array]) -> Iterator[Defect]:
    """Episodes in which two cameras have each the mean picture that is usual for the other."""
    of_camera: dict[str, list[Array]] = defaultdict(list)
    for (camera, _), picture in pictures.items():
        of_camera[camera].append(picture)
    middle = {camera: np.median(own, axis=0) for camera, own in of_camera.items() if len(own) >= LEAST_EPISODES}
    for one, other in combinations(middle, 2):
        if middle[one].shape != middle[other].shape:
            continue
        for episode in sorted(m for camera, m in pictures if camera == one and (other, m) in pictures):
            a, b = pictures[one, episode], pictures[other, episode]
            own = np.abs(a - middle[one]).mean() + np.abs(b - middle[other]).mean()
            if np.abs(a - middle[other]).mean() + np.abs(b - middle[one]).mean() < 0.5 * own:
                said = f"{one} and {other} show what the other shows elsewhere"
                yield Defect("exchanged cameras", str(episode), said)
