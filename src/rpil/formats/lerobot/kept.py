"""The data files of a new folder of LeRobot, with some of the episodes of another and new numbers."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import group_rows
from rpil.data.errors import DataError
from rpil.data.json_files import Parsed
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import commas
from rpil.formats.format import Shot, Trims
from rpil.formats.lerobot import video
from rpil.formats.meta_folder import fill
from rpil.formats.parquet import keep_rows
from rpil.formats.parquet_pages import read_table
from rpil.formats.store import find_files
from rpil.formats.table import numbers_or_missing
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

END_MARKS = "next.done", "next.success", "next.terminated", "next.truncated"
"""Columns that say in the last row how an episode ends."""

REWARD = "next.reward"

PATHS = {
    "v3.0": (
        "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    )
} | dict.fromkeys(
    ("v2.1", "v2.0"),
    (
        "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
    ),
)
"""Where LeRobot has its data and its videos, by its version."""


@dataclass
class Kept:
    """What is written: the episodes `wanted`, with new numbers from 0 in the order of the files."""

    path: Path
    new: Path
    info: dict[str, Parsed]  # what meta/info.json says
    wanted: set[str]
    trims: Trims  # by the old numbers as text
    numbers: dict[int, int] = field(default_factory=dict)  # the new one by the old one
    files: dict[int, tuple[int, int]] = field(default_factory=dict)  # chunk and file by the new number
    lengths: Counter[int] = field(default_factory=Counter)
    n_steps: int = 0
    skipped: dict[int, float] = field(default_factory=dict)  # seconds that rows lose at their head, by the old number
    marks: dict[str, dict[int, Parsed]] = field(default_factory=dict)  # of the last rows of trimmed episodes, by column
    place: tuple[int, int] = (0, 0)

    @property
    def is_v3(self) -> bool:
        return str(self.info["codebase_version"]) == "v3.0"

    @property
    def fps(self) -> float:
        return float(self.info["fps"])

    def place_of(self, number: int) -> tuple[int, int]:
        """The chunk and the file of the new data file, or video of a camera, of this number."""
        chunk, file = divmod(number, int(self.info["chunks_size"]))
        return (chunk, file) if self.is_v3 else (chunk, number)

    def target(self, of_videos: int, chunk: int, file: int, camera: str = "") -> Path:
        """The place of a new file."""
        return self.new / fill(PATHS[self.info["codebase_version"]][of_videos], chunk, file, camera)

    def find_heads(self, videos: Mapping[str, Mapping[int, Shot]]) -> None:
        """Find where trimmed videos of version 2 can begin: with a frame, the same in all cameras, that needs no other.

        Version 2 cannot say that an episode begins within its video, so that the times of its rows begin there.
        """
        for name, (first, _) in self.trims.items():
            shots = [shots[int(name)] for shots in videos.values() if int(name) in shots]
            common = set(range(first + round(shots[0].start * self.fps if shots else 0) + 1))
            for shot in shots:
                packets = video.Packets.of(shot.path)
                common &= set(np.rint(packets.times[packets.is_key] * self.fps).astype(int).tolist())
            self.skipped[int(name)] = max(common, default=0) / self.fps

    def span(self, shot: Shot) -> tuple[float, float]:
        """The seconds of a video that are kept of an episode."""
        first, end = self.trims.get(str(shot.episode), (0, shot.n_rows))
        last = shot.start + end / self.fps
        if not self.is_v3:
            return self.skipped.get(shot.episode, 0.0), last
        return shot.start + first / self.fps, shot.end if end >= shot.n_rows else min(shot.end, last)

    def copy_data(self) -> None:
        """Write the data files that hold any of the episodes."""
        n_files, files = 0, [*map(Path, find_files(self.path)[1])]
        rewarded = [name for file in files if self.trims for name in self._read_marks(file)]
        if rewarded:
            message = f"{self.path}: {REWARD!r} of rows that are cut is not in the new folder, of the demonstrations "
            warnings.warn(f"{message}{commas(rewarded, 5)}.", stacklevel=1)
        for file in files:
            self.place = self.place_of(n_files)
            target = self.target(0, *self.place)
            target.parent.mkdir(parents=True, exist_ok=True)
            if keep_rows(file, target, self.wanted, ColumnOptions(id="episode_index"), self.renumbered):
                n_files += 1
            else:
                target.unlink()
            if not self.is_v3 and len(self.numbers) != n_files:
                raise DataError(f"{file}: it holds several episodes, or one of another file; repair the data set.")
        for name, (first, end) in self.trims.items():
            if name in self.wanted and self.lengths[self.numbers.get(int(name), -1)] != end - first:
                raise DataError(f"{self.path}, demonstration {name}: its frame_index does not count from 0; trim none.")

    def _read_marks(self, file: Path) -> list[str]:
        """Collect the end flags of trimmed episodes; return the episodes that lose a reward."""
        table = read_table(file, ["episode_index", "frame_index", *END_MARKS, REWARD])
        own = table.column_names[2:]
        if not own:
            return []
        old, frames = (table[name].to_numpy() for name in ("episode_index", "frame_index"))
        rewards, rewarded = numbers_or_missing(table[REWARD]) if REWARD in own else None, []
        for name in sorted(self.trims.keys() & self.wanted & set(map(str, np.unique(old).tolist())), key=int):
            first, end = self.trims[name]
            rows = np.flatnonzero(old == int(name))
            for column in own:
                if column != REWARD:
                    self.marks.setdefault(column, {})[int(name)] = table[column][int(rows[-1])].as_py()
            cut = rows[(frames[rows] < first) | (frames[rows] >= end)]
            if rewards is not None and np.nan_to_num(rewards[cut]).any():
                rewarded.append(name)
        return rewarded

    def _with_marks(self, table: pa.Table) -> pa.Table:
        """The rows, of which the last to keep of each trimmed episode says of its end what the old last one said."""
        old, frames = (table[name].to_numpy() for name in ("episode_index", "frame_index")) if self.marks else ((), ())
        for column, of_episode in self.marks.items():
            values = table[column].to_pylist() if column in table.column_names else []
            for m in of_episode.keys() & set(np.unique(old).tolist()) if values else ():
                for row in np.flatnonzero((old == m) & (frames == self.trims[str(m)][1] - 1)):
                    values[row] = of_episode[m]
            table = with_column(table, column, values) if values else table
        return table

    def renumbered(self, table: pa.Table) -> pa.Table:
        """Rows with new numbers of episode and step, without those that are trimmed."""
        import pyarrow as pa

        rows = group_rows(table["episode_index"].to_numpy())[2]
        table = self._with_marks(table if rows is None else table.take(rows))
        old = table["episode_index"].to_numpy()
        for name in self.trims.keys() & set(map(str, np.unique(old).tolist())):
            first, end = self.trims[name]
            frames, own = table["frame_index"].to_numpy(), old == int(name)
            columns = {"frame_index": frames - own * first}
            if "timestamp" in table.column_names:
                times = table["timestamp"].to_numpy()
                moved = np.maximum(times - self.skipped.get(int(name), first / self.fps), 0.0)
                columns["timestamp"] = np.where(own, moved, times)
            for column, values in columns.items():
                table = with_column(table, column, values)
            kept = ~own | ((frames >= first) & (frames < end))
            table, old = table.filter(pa.array(kept)), old[kept]
        last, (episodes, offsets, _) = len(self.numbers) - 1, group_rows(old)
        numbers = [self.numbers.setdefault(m, len(self.numbers)) for m in episodes.tolist()]
        if np.any(np.diff([last, *numbers]) < 0):
            raise DataError(f"{self.path}: its episodes lie within each other; sort the rows by episode_index.")
        for number, n in zip(numbers, np.diff(offsets).tolist(), strict=True):
            self.lengths[number] += n
            self.files.setdefault(number, self.place)
        first, self.n_steps = self.n_steps, self.n_steps + len(old)
        table = with_column(table, "episode_index", np.repeat(numbers, np.diff(offsets)))
        return with_column(table, "index", np.arange(first, self.n_steps)) if "index" in table.column_names else table

    def rows(self, number: int) -> pa.Table:
        """The new rows of an episode."""
        import pyarrow.parquet as pq

        return pq.read_table(self.target(0, *self.files[number]), filters=[("episode_index", "==", number)])


def with_column(table: pa.Table, name: str, values: Sequence[object] | Array) -> pa.Table:
    """The table with other values of the same type in one of its columns."""
    import pyarrow as pa

    field = table.schema.field(name)
    return table.set_column(table.column_names.index(name), field, pa.array(values).cast(field.type))
