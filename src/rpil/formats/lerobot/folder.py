"""LeRobot's folders: what is kept as a list of episodes and as commands, or as a new folder with rows and videos."""

from __future__ import annotations

import json
import re
import shutil
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rpil.data.arrays import group_rows
from rpil.data.errors import DataError, guarded
from rpil.data.files import check_readable, copy_folder
from rpil.data.memory import Parsed, read_json
from rpil.formats import table_folder
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, Shot
from rpil.formats.lerobot import checked_folder
from rpil.formats.lerobot.checked_folder import ByFeature, CheckedFolder, ColumnStatistics
from rpil.formats.metadata import cameras, chunk_size, fill
from rpil.formats.parquet import keep_rows
from rpil.numerics.types import Array

_EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_DATA_PATH, _VIDEO_PATH = checked_folder.PATHS["v3.0"]


def claims(path: Path) -> bool:
    """Whether `path` is a folder with ``meta/info.json`` and ``data``."""
    return (path / "meta" / "info.json").is_file() and (path / "data").is_dir()


def check_output(path: Path, output: Path) -> dict[str, Parsed]:
    """Read ``meta/info.json``; a `DataError` where `keep` cannot write to `output`."""
    info = CheckedFolder(path).info
    version = info.get("codebase_version")
    if version != "v3.0":
        said = f"keep writes folders of LeRobot 3.0, and this one is of version {str(version)[:20]!r}"
        raise DataError(f"{path}: {said}; convert it by LeRobot first, or write the list with -o ids.json.")
    with guarded(path / checked_folder.INFO):
        wrong = [name for name in cameras(info, "video") if not re.fullmatch(r"\w[\w.-]*", name)]
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
    n_in_chunk: int  # files of a folder of files
    wanted: Set[str]
    numbers: dict[int, int] = field(default_factory=dict)  # the new one by the old one
    places: dict[int, tuple[int, int]] = field(default_factory=dict)  # chunk and file of the data, by the new number
    lengths: Counter[int] = field(default_factory=Counter)
    n_steps: int = 0
    place: tuple[int, int] = (0, 0)  # of the data file that is written

    def target(self, template: str, place: tuple[int, int], camera: str = "") -> Path:
        """The path of a new file, in a folder that is there."""
        path = self.new / fill(template, *place, camera)
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

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

    def write_episodes(self, videos: Mapping[str, Mapping[int, Shot]]) -> list[ByFeature]:
        """Write what is said of the kept episodes, with their new numbers and places, and their videos, in which
        `videos` say where each camera saw each episode. Returned are the statistics of each episode."""
        rows, statistics = {m: dict(self.old.episodes[m]) for m in self.numbers}, self.old.statistics()
        start, found = 0, []
        for m, new in self.numbers.items():
            n, firsts, own = self.lengths[new], {"index": start, "episode_index": new}, statistics[m]
            rows[m] |= {"length": n, "episode_index": new, "dataset_from_index": start, "dataset_to_index": start + n}
            for name, place in {"data": self.places[new], "meta/episodes": (0, 0)}.items():
                rows[m] |= {f"{name}/chunk_index": place[0], f"{name}/file_index": place[1]}
            own |= {name: moved(own[name], to) for name, to in firsts.items() if "min" in own.get(name, ())}
            rows[m] |= {f"stats/{feature}/{name}": x for feature, one in own.items() for name, x in one.items()}
            found.append(own)
            start += n
        for camera, shots in videos.items():  # a file with any of these episodes is copied whole
            places = dict[Path, tuple[int, int]]()
            for shot in (shots[m] for m in self.numbers):
                if shot.path not in places:
                    places[shot.path] = divmod(len(places), self.n_in_chunk)
                    shutil.copyfile(check_readable(shot.path), self.target(_VIDEO_PATH, places[shot.path], camera))
                where = zip(("chunk_index", "file_index"), places[shot.path], strict=True)
                said = {**dict(where), "from_timestamp": shot.start, "to_timestamp": shot.end}
                rows[shot.episode] |= {f"videos/{camera}/{name}": value for name, value in said.items()}
        pq.write_table(pa.Table.from_pylist([*rows.values()], self.old.schema), self.target(_EPISODES, (0, 0)))
        return found


def moved(of_episode: ColumnStatistics, first: int) -> dict[str, Parsed]:
    """Statistics of numbers in an episode that are renumbered from `first` on."""
    by = first - int(np.min(of_episode["min"]))
    return {name: x if name in ("std", "count") else np.add(x, by).tolist() for name, x in of_episode.items()}


def with_column(table: pa.Table, name: str, values: Sequence[object] | Array) -> pa.Table:
    """The table with other values of the same type in one of its columns."""
    field = table.schema.field(name)
    return table.set_column(table.column_names.index(name), field, pa.array(values).cast(field.type))


def keep(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> None:
    """Write a new folder in the layout of version 3.0."""
    info, old, meta = check_output(path, output), CheckedFolder(path), output / "meta"
    kept, seen = Kept(old, output, int(info["chunks_size"]), ids), defaultdict[str, dict[int, Shot]](dict)
    with guarded(old.path / "meta" / "episodes"):
        if old.schema is None:
            raise DataError(f"{old.path}: meta/episodes is not that of version 3.0; repair it.")
        if missing := sorted(ids - {*map(str, old.episodes)}):
            raise DataError(f"{old.path}, demonstration {missing[0]}: it is not in meta/episodes; repair the data set.")
        for shot in old.shots(ids):
            seen[shot.camera][shot.episode] = shot
            if not shot.path.is_file():
                ways = "download it, leave its episodes out, or write the list with -o ids.json"
                raise DataError(f"{shot.path}: this video is not there; {ways}.")
    copy_folder(old.path / "meta", meta, without=("episodes", "info.json"))
    for n, file in enumerate(old.data_files(ids)):
        kept.place = divmod(n, kept.n_in_chunk)
        keep_rows(file, kept.target(_DATA_PATH, kept.place), ids, ColumnOptions(id="episode_index"), kept.renumbered)
    with guarded(old.path / "meta" / "episodes"):
        by_episode, n = kept.write_episodes(seen), len(kept.numbers)
        info |= {"total_episodes": n, "total_frames": kept.n_steps, "data_path": _DATA_PATH}
        info |= {"splits": {"train": f"0:{n}"}} | ({"video_path": _VIDEO_PATH} if seen else {})
        (meta / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
    with guarded(old.path / checked_folder.STATS):
        if (place := output / checked_folder.STATS).is_file():  # statistics of a feature that none has by episode stay
            stats = read_json(place)
            for name in stats.keys() & set.intersection(*map(set, by_episode)):
                stats[name] = checked_folder.joined_stats([own[name] for own in by_episode])
            place.write_text(json.dumps(stats, indent=4), encoding="utf-8")


FORMAT = Format(
    name="LeRobot",
    claims=claims,
    read=table_folder.read,
    keep=keep,
    unkept=lambda _, options: "folder by other ids than its own" if options.id else "",
    check_output=check_output,
    find_defects=checked_folder.find_defects,
    annotate=checked_folder.annotate,
    shots=checked_folder.find_shots,
)
