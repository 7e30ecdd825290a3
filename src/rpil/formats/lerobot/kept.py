"""What is written of some episodes of a folder of LeRobot: their rows, what ``meta`` says of them, and their videos."""

from __future__ import annotations

import json
import shutil
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rpil.data.arrays import group_rows
from rpil.data.errors import DataError
from rpil.data.files import new_folder
from rpil.data.folders import check_inside, copy_folder
from rpil.data.json_files import Parsed
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Shot
from rpil.formats.lerobot import video
from rpil.formats.lerobot.checked_folder import EPISODES_STATS, PATHS, ByFeature, CheckedFolder, shifted_stats
from rpil.formats.meta_folder import fill
from rpil.formats.parquet import keep_rows
from rpil.formats.parquet_file import read_table
from rpil.numerics.types import Array

_EPISODES = "meta/episodes/chunk-000/file-000.parquet"


@dataclass
class Kept:
    """What is written: the episodes `wanted`, with new numbers from 0 in the order of the files."""

    old: CheckedFolder
    new: Path
    info: dict[str, Parsed]  # what meta/info.json says
    wanted: set[str]
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
        n_files, files = 0, self.old.files(self.wanted)
        for file in files:
            self.place = self.place_of(n_files)
            target = self.target(0, *self.place)
            options = ColumnOptions(id="episode_index")
            if keep_rows(file, target, self.wanted, options, self.renumbered):
                n_files += 1
            else:
                target.unlink()
            if not self.is_v3 and len(self.numbers) != n_files:
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
            n = self.lengths[new]
            rows[m].update(episode_index=new, length=n)
            if self.is_v3:
                rows[m].update(dataset_from_index=start, dataset_to_index=start + n)
                for name, place in {"data": self.places[new], "meta/episodes": (0, 0)}.items():
                    rows[m] |= {f"{name}/chunk_index": place[0], f"{name}/file_index": place[1]}
            if statistics:
                own = {feature: one for feature, one in statistics[m].items() if feature not in gone}
                for feature, number in (("episode_index", new), ("index", start)):  # which are counted again
                    if feature in own:
                        own[feature] = shifted_stats(own[feature], number - np.ravel(own[feature]["min"])[0].item())
                found.append(own)
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
            _write_lines(self.new / "meta" / "episodes.jsonl", rows.values())
            if found:
                lines = [{"episode_index": new, "stats": own} for new, own in enumerate(found)]
                _write_lines(self.new / EPISODES_STATS, lines)
        return found

    def _copy_videos(self, camera: str, shots: Sequence[Shot]) -> dict[int, dict[str, Parsed]]:
        """Write the videos of a camera; by the old number of each episode, where in them it lies.

        A file of which all episodes are kept whole is copied; of others, the frames of the kept ones.
        """
        n_episodes = Counter(self.old.video(camera, m) for m in self.old.episodes)
        by_file, said = defaultdict[Path, list[Shot]](list), {}
        for shot in shots:
            by_file[shot.path].append(shot)
        for number, (source, own) in enumerate(by_file.items()):
            chunk, file = self.place_of(number)
            target = self.target(1, chunk, file, camera)
            spans = [(shot.start, shot.end) for shot in own]
            if len(own) == n_episodes[source]:
                shutil.copyfile(source, target)
            else:
                starts = video.cut(source, target, spans, float(self.info["fps"]))
                spans = [(start, start + b - a) for start, (a, b) in zip(starts, spans, strict=True)]
            for shot, (start, end) in zip(own, spans, strict=True):
                where = {"chunk_index": chunk, "file_index": file, "from_timestamp": start, "to_timestamp": end}
                said[shot.episode] = {f"videos/{camera}/{name}": value for name, value in where.items()}
        return said


def with_column(table: pa.Table, name: str, values: Sequence[object] | Array) -> pa.Table:
    """The table with other values of the same type in one of its columns."""
    field = table.schema.field(name)
    return table.set_column(table.column_names.index(name), field, pa.array(values).cast(field.type))


def _write_lines(place: Path, rows: Iterable[Mapping[str, Parsed]]) -> None:
    place.write_text("".join(f"{json.dumps(row)}\n" for row in rows), encoding="utf-8")


def annotate(path: Path, output: Path, columns: Mapping[str, Mapping[str, object]]) -> None:
    """Copy the data, the videos and ``meta``, and add `columns`, by name, with a value for each episode's number as
    text; null where there is none. Columns of these names that are there already are replaced."""
    for entry in (path / "videos").rglob("*"):
        check_inside(entry, path)
    with new_folder(output) as new:
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
