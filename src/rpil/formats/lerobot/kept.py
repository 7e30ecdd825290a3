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
from rpil.formats.format import Shot
from rpil.formats.lerobot import video
from rpil.formats.meta_folder import fill
from rpil.formats.parquet import keep_rows
from rpil.formats.parquet_file import read_table
from rpil.formats.places import Cuts
from rpil.formats.store import find_files
from rpil.formats.table import numbers_or_missing
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

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
    cuts: Cuts  # by the old numbers
    numbers: dict[int, int] = field(default_factory=dict)  # the new one by the old one
    files: dict[int, tuple[int, int]] = field(default_factory=dict)  # chunk and file by the new number
    lengths: Counter[int] = field(default_factory=Counter)
    n_steps: int = 0
    skipped: dict[int, float] = field(default_factory=dict)  # seconds that rows lose at their head, by the old number
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
        for name, cut in self.cuts.items():
            shots = [shots[int(name)] for shots in videos.values() if int(name) in shots]
            common = set(range(cut.first + round(shots[0].start * self.fps if shots else 0) + 1))
            for shot in shots:
                packets = video.Packets.of(shot.path)
                common &= set(np.rint(packets.times[packets.is_key] * self.fps).astype(int).tolist())
            self.skipped[int(name)] = max(common, default=0) / self.fps

    def span(self, shot: Shot) -> tuple[float, float]:
        """The seconds of a video that are kept of an episode."""
        cut = self.cuts.get(str(shot.episode))
        first, end = (cut.first, cut.end) if cut else (0, shot.n_rows)
        last = shot.start + end / self.fps
        if not self.is_v3:
            return self.skipped.get(shot.episode, 0.0), last
        return shot.start + first / self.fps, shot.end if end >= shot.n_rows else min(shot.end, last)

    def copy_data(self) -> None:
        """Write the data files that hold any of the episodes."""
        n_files, files = 0, [*map(Path, find_files(self.path)[1])]
        rewarded = [name for file in files if self.cuts for name in self._rewarded(file)]
        if rewarded:
            message = f"{self.path}: {REWARD!r} of rows that are cut is not in the new folder, of the demonstrations "
            warnings.warn(f"{message}{commas(rewarded, 5)}.", stacklevel=1)
        for file in files:
            self.place = self.place_of(n_files)
            target = self.target(0, *self.place)
            target.parent.mkdir(parents=True, exist_ok=True)
            options = ColumnOptions(id="episode_index")
            if keep_rows(file, target, self.wanted, options, self.cuts, self.renumbered):
                n_files += 1
            else:
                target.unlink()
            if not self.is_v3 and len(self.numbers) != n_files:
                raise DataError(f"{file}: it holds several episodes, or one of another file; repair the data set.")

    def _rewarded(self, file: Path) -> list[str]:
        """The episodes in a file that lose a reward where steps are cut."""
        table = read_table(file, ["episode_index", REWARD])
        rewards = numbers_or_missing(table[REWARD]) if REWARD in table.column_names else None
        if rewards is None:
            return []
        old = table["episode_index"].to_numpy()
        own = {name: rewards[old == int(name)] for name in sorted(self.cuts, key=int)}
        lost = {name: np.delete(own[name], self.cuts[name].rows(), axis=0) for name in own if len(own[name])}
        return [name for name, values in lost.items() if np.nan_to_num(values).any()]

    def renumbered(self, table: pa.Table) -> pa.Table:
        """Rows with new numbers of episode and step."""
        rows = group_rows(table["episode_index"].to_numpy())[2]
        table = table if rows is None else table.take(rows)
        old = table["episode_index"].to_numpy()
        for name in self.cuts.keys() & set(map(str, np.unique(old).tolist())):
            first, own = self.cuts[name].first, old == int(name)
            before = {"frame_index": first, "timestamp": self.skipped.get(int(name), first / self.fps)}
            for column in before.keys() & {*table.column_names}:
                values = table[column].to_numpy()
                table = with_column(table, column, np.where(own, np.maximum(values - before[column], 0), values))
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
        import pyarrow.compute as pc

        table = read_table(self.target(0, *self.files[number]))
        return table.filter(pc.equal(table["episode_index"], number))


def with_column(table: pa.Table, name: str, values: Sequence[object] | Array) -> pa.Table:
    """The table with other values of the same type in one of its columns."""
    import pyarrow as pa

    field = table.schema.field(name)
    return table.set_column(table.column_names.index(name), field, pa.array(values).cast(field.type))
