"""Whether what LeRobot's ``meta`` says, and its videos, agree with the data."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from rpil.data.errors import DataError, MissingExtraError
from rpil.data.guard import guarded
from rpil.data.json_files import read_json
from rpil.data.names import spans
from rpil.formats.description import commas
from rpil.formats.format import Defect, Shot
from rpil.formats.lerobot import stats
from rpil.formats.lerobot.checked_folder import EPISODES_STATS, INFO, PATHS, STATS, CheckedFolder
from rpil.formats.lerobot.video import load_av
from rpil.formats.lerobot.video_faults import find_faults
from rpil.formats.meta_folder import cameras, fill, frame_rate

TOLERANCE, SHARES = 1e-3, (1e-5, 1e-3)
"""Standard deviations, and shares of the largest value, the second for a standard deviation, by which a statistic may
differ: LeRobot subtracts squares of short floats."""


def find_shots(path: Path) -> list[Shot]:
    """Where the frames of each episode of the folder are; a `DataError` where ``meta`` does not say."""
    with guarded(path / "meta"):
        return CheckedFolder(path).shots()


def find_defects(path: Path, look: bool) -> list[Defect]:
    """What of a folder does not agree with its data; `look` decodes the videos, which takes a while."""
    folder = CheckedFolder(path)
    found: dict[Defect, None] = {}
    for rule in (in_times, _in_totals, _in_episodes, _in_statistics, partial(in_videos, look=look)):
        try:
            with guarded(path / "meta"):
                found |= dict.fromkeys(rule(folder))
        except DataError as error:
            found[Defect("metadata", "meta", str(error).rstrip("."))] = None
    return list(found)


def in_times(folder: CheckedFolder, only: Collection[str] | None = None) -> Iterator[Defect]:
    """Episodes, `only` these or all, with times that LeRobot does not find in a video, or of other frames a second."""
    wrong = {m: rows for m, rows in folder.data.items() if rows.off and (only is None or str(m) in only)}
    if wrong:
        fps, off = float(folder.info["fps"]), np.max([rows.off for rows in wrong.values()])
        recorded = np.median([rows.fps for rows in wrong.values()])
        why = f"declared are {fps:.3g} frames a second, recorded {recorded:.3g}; timestamps are up to {off:.3g} s off"
        why = why if recorded else "times do not rise"
        why = "a timestamp is no number" if np.isnan(off) else why
        loads = f"{why}; LeRobot loads these rows all the same, for they have no videos"
        said = f"LeRobot cannot load these rows: {why}" if cameras(folder.info, "video") else loads
        remedy = f"write frame_index / {fps:.6g} in their place"
        yield Defect("timestamps", _named([*wrong], folder), f"{said}; {remedy}")


def _named(episodes: Sequence[int], folder: CheckedFolder) -> str:
    """Some episodes of a folder in words, as "episodes 3 to 7 and 9"."""
    if len(episodes) == len(folder.data):
        return f"all {len(episodes)} episodes"
    runs = np.split(np.sort(episodes), np.flatnonzero(np.diff(np.sort(episodes)) != 1) + 1)
    texts = ", ".join(spans(run.tolist() for run in runs))
    return f"episode{'s' * (len(episodes) > 1)} {' and '.join(texts.rsplit(', ', 1))}"


def in_videos(folder: CheckedFolder, look: bool) -> Iterator[Defect]:
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


def _in_statistics(folder: CheckedFolder) -> Iterator[Defect]:
    place = folder.path / STATS
    if not place.is_file() or folder.data.keys() != folder.episodes.keys():
        return
    left_out = {*cameras(folder.info, "image", "video")}  # of whose pictures rpil computes none
    left_out |= {"timestamp"} if any(rows.off for rows in folder.data.values()) else set()
    said = {name: one for name, one in read_json(place).items() if name not in left_out}
    for name, found in stats.of_data(folder.path / "data", dict.fromkeys(said, stats.MOMENTS)).items():
        names = [what for what in ("min", "max", "mean", "std") if what in said[name]]
        largest = np.max([np.abs(found[what]) for what in names], axis=0) if names else 0.0
        for what in names:
            slack = TOLERANCE * np.asarray(found.get("std", 0.0)) + SHARES[what == "std"] * largest + 1e-9
            here, data = np.ravel(said[name][what]), np.ravel(found[what])
            if here.shape != data.shape or not (np.abs(here - data) <= slack).all():
                numbers = (commas([f"{number:.6g}" for number in values], 3) for values in (here, data))
                yield Defect("statistics", STATS, "{} of {} is {}; of the data {}".format(what, name, *numbers))
                break
