"""A folder of LeRobot: its episodes, rows, videos and statistics, and whether ``meta`` agrees with the data."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rpil.data.arrays import group_rows
from rpil.data.errors import DataError, MissingExtraError, guarded
from rpil.data.files import check_inside, copy_folder, replacing
from rpil.data.memory import Parsed
from rpil.formats.format import Defect, Shot
from rpil.formats.lerobot.video import NEAR_SECONDS, find_faults, load_av
from rpil.formats.parquet import MetaFolder, fill, frame_rate
from rpil.formats.parquet_file import read_table
from rpil.formats.places import usual_step
from rpil.formats.scan import parts_in_words, without_damaged
from rpil.formats.table import flattened, numbers_or_missing, parts_of_lists
from rpil.formats.table_folder import find_files
from rpil.numerics.types import Array

INFO, STATS, EPISODES_STATS = "meta/info.json", "meta/stats.json", "meta/episodes_stats.jsonl"

DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
"""Where LeRobot 3.0 has its data and its videos."""


class EpisodeRows(NamedTuple):
    """Rows of an episode: how many, the first ``index`` or -1, the file, and the seconds at which they begin.

    Where they are `off` by more seconds than LeRobot takes, at `fps` a second or 0 if time goes back, they begin at 0.
    """

    n: int
    first: int
    file: str
    start: float
    off: float
    fps: float


def rows_of_episodes(table: pa.Table) -> dict[int, Array]:
    """The rows of each episode in a table, by its number, in the order in which episodes first appear."""
    numbers, offsets, rows = group_rows(table["episode_index"].to_numpy())
    each = np.split(np.arange(len(table)) if rows is None else rows, offsets[1:-1])
    return dict(zip(numbers.tolist(), each, strict=False))  # one part without rows where the table has none


@dataclass(frozen=True, eq=False)
class CheckedFolder(MetaFolder):
    """A folder of LeRobot; errors of reading are `DataError`."""

    @cached_property
    def data(self) -> dict[int, EpisodeRows]:
        """The rows of each episode, by the data; of those in damaged files there are none."""
        return {m: rows for own in self._by_file.values() for m, rows in own.items()}

    @cached_property
    def _by_file(self) -> dict[str, dict[int, EpisodeRows]]:
        return without_damaged(map(str, find_files(self.path)[0]), self._rows_in)[0]

    def check_whole(self) -> None:
        """A `DataError` where an episode lies in two files."""
        found: dict[int, EpisodeRows] = {}
        for own in self._by_file.values():
            for m in own.keys() & found.keys():
                said = f"it is both in {found[m].file} and in {own[m].file}; write its rows to one file"
                raise DataError(f"{self.path}, demonstration {m}: {said}.")
            found |= own

    def _rows_in(self, file: str) -> dict[int, EpisodeRows]:
        with guarded(file):
            table = read_table(file, ["episode_index", "index", "timestamp"])
        found, columns, place = dict[int, EpisodeRows](), table.column_names, os.path.relpath(file, self.path)
        all_times = numbers_or_missing(table["timestamp"]) if "timestamp" in columns else None
        fps, has_videos = frame_rate(self.info.get("fps")), bool(self.cameras("video"))
        for m, own in rows_of_episodes(table).items():
            first = table["index"][int(own[0])].as_py() if "index" in columns else -1
            timing, frames = (0.0, 0.0, 0.0), np.arange(len(own))
            if fps is not None and all_times is not None:
                times, steps = all_times[own], np.diff(all_times[own])
                if str(self.info.get("codebase_version")).startswith("v2"):  # which may begin within a video
                    frames = frames + np.rint(times[0] * fps)
                gaps = times - frames / fps if has_videos else steps - 1 / fps
                off = float(np.abs(gaps).max(initial=0.0))
                timing = float(times[0]), 0.0, 0.0
                if not off <= NEAR_SECONDS:
                    timing = 0.0, off, 0.0 if (steps < 0).any() else 1.0 / (usual_step(steps) or np.inf)
            found[m] = EpisodeRows(len(own), first, place, *timing)
        return found

    def states(self) -> dict[int, Array]:
        """The state of each episode, (N, D), as that of the joints of a robot; empty where the data have none."""
        names = [name for name in self.info["features"] if name.startswith(("observation.state", "state"))]
        found: dict[int, Array] = {}
        for file in dict.fromkeys(self.path / rows.file for rows in self.data.values()):
            table = read_table(file, ["episode_index", *names])
            lists = parts_of_lists(table, {})
            wanted = [part for name in table.column_names[1:] for part in lists.get(name, (name,))]
            values = map(numbers_or_missing, flattened(table, lists, wanted).columns)
            if columns := [one for one in values if one is not None]:
                joined = np.stack(columns, axis=1)
                found |= {m: joined[rows] for m, rows in rows_of_episodes(table).items()}
        return found

    @cached_property
    def episodes(self) -> dict[int, dict[str, Parsed]]:
        """Facts in ``meta`` of each episode, without its statistics; empty where it says nothing."""
        rows = self.rows("episodes", lambda column: not column.startswith("stats/"))
        return {int(row["episode_index"]): row for row in rows}

    @cached_property
    def schema(self) -> pa.Schema | None:
        """The schema of the table of the episodes; None where it is no Parquet file."""
        schemas = [pq.read_schema(str(place)) for place in self.tables("episodes")]
        return pa.unify_schemas(schemas, promote_options="permissive") if schemas else None

    def shots(self, only: Collection[str] | None = None) -> list[Shot]:
        """Where the frames of each episode that is there, `only` these or all, are, by camera; a `DataError` where
        ``meta`` does not say, or a video lies outside the folder."""
        found: list[Shot] = []
        n_in_chunk = frame_rate(self.info.get("chunks_size", 1000)) or 0.5
        if not n_in_chunk.is_integer():
            said = str(self.info["chunks_size"])[:20]
            raise DataError(f"{self.path / INFO}: chunks_size is {said}, no whole number above 0; correct it.")
        fps = frame_rate(self.info.get("fps")) or np.inf
        there = [m for m in sorted(self.data.keys() & self.episodes.keys()) if only is None or str(m) in only]
        for camera in self.cameras("video"):
            own = []
            for m in there:
                row = self.episodes[m]
                # Version 2 has no such column: there, frames before the first row's time belong to no row.
                start = row.get(f"videos/{camera}/from_timestamp", self.data[m].start)
                end = row.get(f"videos/{camera}/to_timestamp", np.inf)
                if not (isinstance(start, int | float) and isinstance(end, int | float) and -1 < start < end):
                    said = f"from_timestamp is {start!s:.20}, to_timestamp {end!s:.20}; correct them"
                    raise DataError(f"meta/episodes, demonstration {m}: {said}.")
                names = [f"videos/{camera}/{name}" for name in ("chunk_index", "file_index")]
                chunk, file = (row[name] for name in names) if names[0] in row else (m // int(n_in_chunk), m)
                if not isinstance(template := self.info.get("video_path"), str):
                    raise DataError(f"{self.path / INFO}: video_path is not there; write the path of the videos.")
                check_inside(place := self.path / fill(template, chunk, file, camera), self.path)
                own.append(Shot(camera, m, place, start, end, self.data[m].n))
            starts = defaultdict[Path, list[float]](list)
            for shot in own:
                starts[shot.path].append(shot.start)
            later = {path: np.append(np.sort(times), np.inf) for path, times in starts.items()}
            for shot in own:  # some programs write the time of the last frame: none reaches beyond the next one's start
                following = later[shot.path][np.searchsorted(later[shot.path], shot.start, "right")]
                last = float(min(shot.start + shot.n_rows / fps, following))
                found.append(replace(shot, end=max(shot.end, last)))
        return found


def annotate(path: Path, output: Path, columns: Mapping[str, Mapping[str, object]]) -> None:
    """Copy the data, the videos and ``meta``, and add `columns`, by name, with a value for each episode's number as
    text; null where there is none. Columns of these names that are there already are replaced."""
    for entry in (path / "videos").rglob("*"):
        check_inside(entry, path)
    with replacing(output) as new:
        new.mkdir()
        for name in ("data", "meta", "videos"):
            if (path / name).is_dir():
                copy_folder(path / name, new / name)
        for place in (new / "meta" / "episodes").rglob("*.parquet"):
            table = read_table(place)
            episodes = [*map(str, table["episode_index"].to_pylist())]
            table = table.drop_columns([name for name in columns if name in table.column_names])
            for name, values in columns.items():
                table = table.append_column(name, pa.array([values.get(episode) for episode in episodes]))
            pq.write_table(table, place)


def find_shots(path: Path) -> list[Shot]:
    """Where the frames of each episode of the folder are; a `DataError` where ``meta`` does not say."""
    with guarded(path / "meta"):
        return CheckedFolder(path).shots()


def find_defects(path: Path, look: bool) -> list[Defect]:
    """Find what of a folder does not agree with its data; `look` decodes the videos, which takes a while."""
    folder = CheckedFolder(path)
    found: dict[Defect, None] = {}
    for rule in (_in_times, _in_counts, _in_episodes, partial(_in_videos, look=look)):
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
        why = "a timestamp is no number" if np.isnan(off) else "time stands still or goes back"
        if not np.isnan(off) and (rates := [rows.fps for rows in wrong.values() if rows.fps]):
            why = f"declared are {fps:.3g} frames a second, recorded {np.median(rates):.3g}"
            why += f"; timestamps are up to {off:.3g} s off"
        said = f"LeRobot cannot load these rows: {why}"
        if not folder.cameras("video"):
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


def _in_counts(folder: CheckedFolder) -> Iterator[Defect]:
    totals = {"total_episodes": len(folder.data), "total_frames": sum(rows.n for rows in folder.data.values())}
    for name, number in totals.items():
        if folder.info.get(name, number) != number:
            said = f"{name} is {str(folder.info[name])[:40]}, and the data hold {number}"
            yield Defect("totals", INFO, said)
    if gaps := {*range(max(folder.data, default=-1) + 1)} - folder.data.keys():
        shown, n = parts_in_words(gaps, "episode", []), len(folder.data)
        said = f"{shown} {'is' if len(gaps) == 1 else 'are'} missing of 0-{max(folder.data)}"
        remedy = f"LeRobot looks for episodes and videos by position; number the {n} that are there from 0 to {n - 1}"
        yield Defect("missing episodes", "data", f"{said}; {remedy}, as rpil keep does")


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
        wrong = [f"{name} is {row[name]}, not {own}" for name, own in expected.items() if row.get(name, own) != own]
        places = [row[f"data/{name}"] for name in ("chunk_index", "file_index") if f"data/{name}" in row]
        named = fill(str(folder.info.get("data_path") or DATA_PATH), *places) if places else file
        wrong += [f"its data are in {file}, not in {named}"] if named != file else []
        if wrong:
            yield Defect("episode table", str(m), "; ".join(wrong))
