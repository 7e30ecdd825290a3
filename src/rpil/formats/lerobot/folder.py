"""LeRobot's folders: what is kept as a list of episodes and as commands, or as a new folder with rows and videos."""

from __future__ import annotations

import json
import re
import shutil
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rpil.data.arrays import group_rows
from rpil.data.errors import DataError
from rpil.data.files import check_readable, copy_folder
from rpil.data.guard import guarded
from rpil.data.json_files import Parsed, read_json
from rpil.data.names import quoted
from rpil.formats import table_folder
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, Shot
from rpil.formats.lerobot.checked_folder import (
    EPISODES_STATS,
    INFO,
    PATHS,
    STATS,
    ByFeature,
    CheckedFolder,
    ColumnStatistics,
    annotate,
    find_defects,
    find_shots,
    joined_stats,
)
from rpil.formats.metadata import cameras, chunk_size, fill
from rpil.formats.parquet import keep_rows
from rpil.numerics.types import Array

_EPISODES = "meta/episodes/chunk-000/file-000.parquet"


def claims(path: Path) -> bool:
    """Whether `path` is a folder with ``meta/info.json`` and ``data``."""
    return (path / "meta" / "info.json").is_file() and (path / "data").is_dir()


def check_output(path: Path, output: Path) -> dict[str, Parsed]:
    """Read ``meta/info.json``; a `DataError` where `keep` cannot write to `output`."""
    info = CheckedFolder(path).info
    version = info.get("codebase_version")
    if version not in PATHS:
        raise DataError(f"{path}: a folder of version {str(version)[:20]!r} cannot be given back; name a .json file.")
    with guarded(path / INFO):
        seen = cameras(info, "video")
        wrong = [name for name in seen if not re.fullmatch(r"\w[\w.-]*", name)]
        info["chunks_size"], fps = chunk_size(info) or 0, float(info["fps"])
        info["fps"] = int(fps) if fps.is_integer() else fps
        if wrong:
            raise ValueError(f"{wrong[0]!r} is no name of a camera")
        if info["chunks_size"] < 1 or not 0 < fps < 1e9:
            raise ValueError("chunks_size is no whole number above 0, or fps none")
    return info


@dataclass
class Kept:
    """The new folder: the episodes `wanted`, with new numbers from 0 in the order of the files."""

    old: CheckedFolder
    new: Path
    info: dict[str, Parsed]  # what meta/info.json says
    wanted: Set[str]
    numbers: dict[int, int] = field(default_factory=dict)  # the new one by the old one
    places: dict[int, tuple[int, int]] = field(default_factory=dict)  # chunk and file of the data, by the new number
    lengths: Counter[int] = field(default_factory=Counter)
    n_steps: int = 0
    place: tuple[int, int] = (0, 0)  # of the data file that is written

    @property
    def is_v3(self) -> bool:
        return str(self.info["codebase_version"]) == "v3.0"

    def place_of(self, number: int) -> tuple[int, int]:
        """The chunk and the file of the new data file, or video of a camera, of this number."""
        chunk, file = divmod(number, int(self.info["chunks_size"]))
        return (chunk, file) if self.is_v3 else (chunk, number)

    def target(self, of_videos: int, chunk: int, file: int, camera: str = "") -> Path:
        """The place of a new file, in a folder that is there."""
        place = self.new / fill(PATHS[self.info["codebase_version"]][of_videos], chunk, file, camera)
        place.parent.mkdir(parents=True, exist_ok=True)
        return place

    def copy_data(self) -> None:
        """Write the data files that hold any of the episodes."""
        for n, file in enumerate(self.old.data_files(self.wanted)):
            self.place = self.place_of(n)
            options = ColumnOptions(id="episode_index")
            keep_rows(file, self.target(0, *self.place), self.wanted, options, self.renumbered)
            if not self.is_v3 and len(self.numbers) != n + 1:
                raise DataError(f"{file}: it holds several episodes, or one of another file; repair the data set.")

    def renumbered(self, table: pa.Table) -> pa.Table:
        """Rows with new numbers of episode and step."""
        rows = group_rows(table["episode_index"].to_numpy())[2]
        table = table if rows is None else table.take(rows)
        old = table["episode_index"].to_numpy()
        last, (episodes, offsets, _) = len(self.numbers) - 1, group_rows(old)
        numbers = [self.numbers.setdefault(m, len(self.numbers)) for m in episodes.tolist()]
        if np.any(np.diff([last, *numbers]) < 0):
            raise DataError(f"{self.old.path}: its episodes lie within each other; sort the rows by episode_index.")
        for number, n in zip(numbers, np.diff(offsets).tolist(), strict=True):
            self.lengths[number] += n
            self.places.setdefault(number, self.place)
        first, self.n_steps = self.n_steps, self.n_steps + len(old)
        table = with_column(table, "episode_index", np.repeat(numbers, np.diff(offsets)))
        return with_column(table, "index", np.arange(first, self.n_steps)) if "index" in table.column_names else table

    def write_episodes(self, videos: Mapping[str, Mapping[int, Shot]], gone: Sequence[str]) -> list[ByFeature]:
        """Write what is said of the kept episodes, with their new numbers and places, and their videos.

        `videos` say where each camera saw each episode; `gone` are the cameras that are left out. Returned are the
        statistics of each episode, if there are any.
        """
        rows, statistics = {m: dict(self.old.episodes[m]) for m in self.numbers}, self.old.statistics()
        start, found = 0, []
        for m, new in self.numbers.items():
            n, firsts = self.lengths[new], {"index": start, "episode_index": new}
            rows[m].update(episode_index=new, length=n)
            if self.is_v3:
                rows[m].update(dataset_from_index=start, dataset_to_index=start + n)
                for name, place in {"data": self.places[new], "meta/episodes": (0, 0)}.items():
                    rows[m] |= {f"{name}/chunk_index": place[0], f"{name}/file_index": place[1]}
            if statistics:
                own = {feature: one for feature, one in statistics[m].items() if feature not in gone}
                found.append(
                    own | {name: moved(own[name], to) for name, to in firsts.items() if "min" in own.get(name, ())}
                )
            start += n
        for camera, shots in videos.items():
            for m, said in self._copy_videos(camera, [shots[m] for m in self.numbers]).items():
                rows[m] |= said if self.is_v3 else {}
        if self.old.schema is not None:
            of_gone = tuple(f"{what}/{camera}/" for camera in gone for what in ("videos", "stats"))
            left = [field for field in self.old.schema if not field.name.startswith(of_gone)]
            for row, own in zip(rows.values(), found, strict=True):
                row |= {f"stats/{feature}/{name}": value for feature, one in own.items() for name, value in one.items()}
            (self.new / _EPISODES).parent.mkdir(parents=True)
            table = pa.Table.from_pylist([*rows.values()], pa.schema(left, self.old.schema.metadata))
            pq.write_table(table, self.new / _EPISODES)
        else:
            lines = [{"episode_index": new, "stats": own} for new, own in enumerate(found)]
            for name, written in {"meta/episodes.jsonl": [*rows.values()], EPISODES_STATS: lines}.items():
                if written:
                    text = "".join(f"{json.dumps(line)}\n" for line in written)
                    (self.new / name).write_text(text, encoding="utf-8")
        return found

    def _copy_videos(self, camera: str, shots: Sequence[Shot]) -> dict[int, dict[str, Parsed]]:
        """Write the videos of a camera; by the old number of each episode, where in them it lies.

        A file with any of these episodes is copied whole: `meta` says where in it each lies.
        """
        places, said = dict[Path, tuple[int, int]](), dict[int, dict[str, Parsed]]()
        for shot in shots:
            if shot.path not in places:
                places[shot.path] = self.place_of(len(places))
                shutil.copyfile(check_readable(shot.path), self.target(1, *places[shot.path], camera))
            chunk, file = places[shot.path]
            where = {"chunk_index": chunk, "file_index": file, "from_timestamp": shot.start, "to_timestamp": shot.end}
            said[shot.episode] = {f"videos/{camera}/{name}": value for name, value in where.items()}
        return said


def moved(of_episode: ColumnStatistics, first: int) -> dict[str, Parsed]:
    """Statistics of numbers in an episode that are renumbered from `first` on."""
    by = first - int(np.min(of_episode["min"]))
    return {name: x if name in ("std", "count") else np.add(x, by).tolist() for name, x in of_episode.items()}


def with_column(table: pa.Table, name: str, values: Sequence[object] | Array) -> pa.Table:
    """The table with other values of the same type in one of its columns."""
    field = table.schema.field(name)
    return table.set_column(table.column_names.index(name), field, pa.array(values).cast(field.type))


def keep(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> None:
    """Write a new folder in the layout of its version."""
    info, old, meta = check_output(path, output), CheckedFolder(path), output / "meta"
    kept = Kept(old, output, info, ids)
    with guarded(old.path / "meta" / "episodes"):
        if (old.schema is not None) != kept.is_v3:
            raise DataError(
                f"{old.path}: meta/episodes is not that of version {info['codebase_version'][1:]}; repair it."
            )
        missing = sorted(kept.wanted - set(map(str, old.episodes)))
        if missing:
            raise DataError(f"{old.path}, demonstration {missing[0]}: it is not in meta/episodes; repair the data set.")
        seen: dict[str, dict[int, Shot]] = {camera: {} for camera in cameras(info, "video")}
        for shot in old.shots(kept.wanted):
            # Before version 3.0 ``meta`` need not say where in its video an episode lies.
            if old.schema is None or f"videos/{shot.camera}/to_timestamp" in old.schema.names:
                seen[shot.camera][shot.episode] = shot
    copy_folder(old.path / "meta", meta, without=("episodes", "info.json"))
    gone = [camera for camera, own in seen.items() if not any(shot.path.is_file() for shot in own.values())]
    for camera in gone:
        del seen[camera], info["features"][camera]
        message = f"{old.path}: no video of {camera!r} is there; the new folder does not name this camera."
        warnings.warn(message, stacklevel=1)
    lost = [shot.path for own in seen.values() for shot in own.values() if not shot.path.is_file()]
    if lost:
        raise DataError(f"{lost[0]}: this video is not there; download it, or leave its episodes out.")
    kept.copy_data()
    with guarded(old.path / "meta" / "episodes"):
        by_episode = kept.write_episodes(seen, gone)
        n, (data, videos) = len(kept.numbers), PATHS[info["codebase_version"]]
        info |= {"total_episodes": n, "total_frames": kept.lengths.total(), "data_path": data}
        info |= {"splits": {"train": f"0:{n}"}} | ({"video_path": videos} if seen else {})
        of_v2 = {"total_videos": n * len(seen), "total_chunks": -(-n // int(info["chunks_size"]))}
        info |= {name: value for name, value in of_v2.items() if name in info}
        (meta / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
    with guarded(old.path / "meta" / "stats.json"):
        _write_statistics(kept, by_episode, gone)


def _write_statistics(kept: Kept, by_episode: Sequence[ByFeature], gone: Sequence[str]) -> None:
    """Write the statistics of all features that ``meta`` has by episode, joined as LeRobot joins them."""
    place = kept.new / STATS
    if not place.is_file():
        return
    old = {name: one for name, one in read_json(place).items() if name not in gone}
    common = set.intersection(*map(set, by_episode)) if by_episode else set[str]()
    found = {name: joined_stats([own[name] for own in by_episode]) for name in old if name in common}
    if left := [name for name in old if name not in found]:
        message = f"{kept.old.path}: the statistics of {quoted(left, 5)} are still those of all episodes, because the "
        warnings.warn(f"{message}recording does not say them by episode.", stacklevel=1)
    place.write_text(json.dumps(old | found, indent=4), encoding="utf-8")


FORMAT = Format(
    name="LeRobot",
    claims=claims,
    read=table_folder.read,
    keep=keep,
    unkept=lambda _, options: "folder by other ids than its own" if options.id else "",
    check_output=check_output,
    find_defects=find_defects,
    annotate=annotate,
    shots=find_shots,
)
