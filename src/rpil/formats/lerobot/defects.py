"""Whether what LeRobot's ``meta`` says, and its videos, agree with the data."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from rpil.data.errors import DataError, MissingExtraError
from rpil.data.guard import guarded
from rpil.data.text import duration
from rpil.formats.format import Defect, Shot
from rpil.formats.lerobot import video
from rpil.formats.lerobot.checked_folder import EPISODES_STATS, INFO, NEAR_SECONDS, PATHS, CheckedFolder
from rpil.formats.lerobot.video import load_av
from rpil.formats.meta_folder import cameras, fill, frame_rate
from rpil.formats.scan import parts_in_words
from rpil.numerics.types import Array


def find_shots(path: Path) -> list[Shot]:
    """Where the frames of each episode of the folder are; a `DataError` where ``meta`` does not say."""
    with guarded(path / "meta"):
        return CheckedFolder(path).shots()


def find_defects(path: Path, look: bool) -> list[Defect]:
    """Find what of a folder does not agree with its data; `look` decodes the videos, which takes a while."""
    folder = CheckedFolder(path)
    found: dict[Defect, None] = {}
    for rule in (_in_times, _in_totals, _in_numbers, _in_episodes, partial(_in_videos, look=look)):
        try:
            with guarded(path / "meta"):
                found |= dict.fromkeys(rule(folder))
        except DataError as error:
            found[Defect("metadata", "meta", str(error).rstrip("."))] = None
    return list(found)


def _in_times(folder: CheckedFolder) -> Iterator[Defect]:
    """Episodes with times that LeRobot does not find in a video, or of other frames a second."""
    if wrong := {m: rows for m, rows in folder.data.items() if rows.off}:
        fps, off = float(folder.info["fps"]), np.max([rows.off for rows in wrong.values()])
        why = "a timestamp is no number" if np.isnan(off) else "times do not rise"
        if not np.isnan(off) and (recorded := np.median([rows.fps for rows in wrong.values()])):
            why = (
                f"declared are {fps:.3g} frames a second, recorded {recorded:.3g}; timestamps are up to {off:.3g} s off"
            )
        said = f"LeRobot cannot load these rows: {why}"
        if not cameras(folder.info, "video"):
            said = f"{why}; LeRobot loads these rows all the same, for they have no videos"
        is_all = len(wrong) == len(folder.data)
        place = f"all {len(wrong)} episodes" if is_all else parts_in_words(wrong, "episode", [])
        yield Defect("timestamps", place, f"{said}; write frame_index / {fps:.6g} in their place")


def _in_videos(folder: CheckedFolder, look: bool) -> Iterator[Defect]:
    """Faults of videos; without the package only files that are not there, unless they are to be looked at."""
    fps, shots = frame_rate(folder.info.get("fps")), folder.shots()
    there = {shot.path for shot in shots if shot.path.is_file()}
    try:
        if there:
            load_av()
    except MissingExtraError:
        if look:
            raise
        shots = [shot for shot in shots if shot.path not in there]
    return find_faults(shots, fps, folder.states() if look else None) if fps else iter(())


def _in_totals(folder: CheckedFolder) -> Iterator[Defect]:
    totals = {"total_episodes": len(folder.data), "total_frames": sum(rows.n for rows in folder.data.values())}
    for name, number in totals.items():
        if folder.info.get(name, number) != number:
            said = f"{name} is {str(folder.info[name])[:40]}, and the data hold {number}"
            yield Defect("totals", INFO, said)


def _in_episodes(folder: CheckedFolder) -> Iterator[Defect]:
    if folder.info.get("codebase_version") == "v2.1" and not (folder.path / EPISODES_STATS).is_file():
        yield Defect("statistics", EPISODES_STATS, "it is not there; LeRobot's converter to version 3.0 needs it")
    if not folder.episodes:
        yield Defect("episode table", "meta", "it does not list the episodes")
        return
    lost = folder.episodes.keys() - folder.data.keys()
    if lost:
        said = f"{len(lost)} of the {len(folder.episodes)} episodes that it lists are not in the data"
        yield Defect("episode table", "meta", f"{said}, the first is {min(lost)}")
    for m, (n, first, file, *_) in folder.data.items():
        row = folder.episodes.get(m)
        if row is None:
            yield Defect("episode table", str(m), "meta does not list it")
            continue
        expected = {"length": n} | ({"dataset_from_index": first, "dataset_to_index": first + n} if first >= 0 else {})
        wrong = [
            f"{name} is {row[name]}, not {value}" for name, value in expected.items() if row.get(name, value) != value
        ]
        places = [row[f"data/{name}"] for name in ("chunk_index", "file_index") if f"data/{name}" in row]
        named = fill(str(folder.info.get("data_path") or PATHS["v3.0"][0]), *places) if places else file
        wrong += [f"its data are in {file}, not in {named}"] if named != file else []
        if wrong:
            yield Defect("episode table", str(m), "; ".join(wrong))


def _in_numbers(folder: CheckedFolder) -> Iterator[Defect]:
    if gaps := {*range(max(folder.data, default=-1) + 1)} - folder.data.keys():
        shown, n = parts_in_words(gaps, "episode", []), len(folder.data)
        said = f"{shown} {'is' if len(gaps) == 1 else 'are'} missing of 0-{max(folder.data)}"
        remedy = f"LeRobot looks for episodes and videos by position; number the {n} that are there from 0 to {n - 1}"
        yield Defect("missing episodes", "data", f"{said}; {remedy}, as rpil keep does")


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
            times, frames = (video.frame_times(path), None) if states is None else video.look(path)
        except DataError as error:
            first, last = own[0].episode, own[-1].episode
            yield Defect("video file", str(first) if first == last else f"{first} to {last}", str(error).rstrip("."))
            continue
        for shot in own:
            inside = (times >= shot.start - 0.5 / fps) & (times < shot.end - 0.5 / fps)
            yield from _of_times(shot, np.sort(times[inside]), fps)
            if frames is not None and inside.any():
                is_black = frames[inside].max(axis=(1, 2)) <= DARK
                if is_black.any():
                    since = duration(float(np.argmax(is_black)), 1 / fps)
                    said = f"{shot.camera} is black in {is_black.sum()} frames of {len(is_black)}, from {since}"
                    yield Defect("black frames", str(shot.episode), said)
                if not is_black.all():
                    still[shot.camera][shot.episode] = _stillness(frames[inside], is_black)
    for camera, of_episode in still.items():
        yield from _unchanged(camera, of_episode, fps, states or {})


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
