"""What LeRobot says of each kept episode, and its videos: a table since version 3.0, lines of JSON before."""

from __future__ import annotations

import json
import shutil
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.errors import DataError
from rpil.data.json_files import LARGEST_TABLE, Parsed, parse_lines, read_text
from rpil.formats.lerobot import stats, video
from rpil.formats.lerobot.kept import Kept, video_place, with_column
from rpil.formats.parquet_pages import read_table

if TYPE_CHECKING:
    import pyarrow as pa

ByFeature = dict[str, dict[str, Parsed]]
"""The statistics of one episode."""

Videos = Mapping[str, Mapping[int, Path]]
"""The file of each episode by camera, where the new folder is to have it."""

_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_OF_VIDEO = "chunk_index", "file_index", "from_timestamp", "to_timestamp"


def read_episodes(path: Path) -> pa.Table:
    """The table of the episodes of a folder of version 3.0; a `DataError` where there is none."""
    import pyarrow as pa

    files = sorted((path / "meta" / "episodes").rglob("*.parquet"))
    if not files:
        raise DataError(f"{path}: meta/episodes has no table of the episodes; download it again.")
    return pa.concat_tables(map(read_table, files), promote_options="permissive")


def _rows_of(names: Sequence[object], wanted: set[str], path: Path) -> dict[int, int]:
    """The row of each wanted episode; a `DataError` where one has none."""
    found = {int(str(name)): row for row, name in enumerate(names) if str(name) in wanted}
    missing = sorted(wanted - set(map(str, found)))
    if missing:
        raise DataError(f"{path}, demonstration {missing[0]}: it is not in meta/episodes; repair the data set.")
    return found


@dataclass(frozen=True, eq=False)
class EpisodeTable:
    """That of version 3.0: videos hold many episodes, and the table says where in them each lies."""

    kept: Kept
    table: pa.Table
    row_of: Mapping[int, int]

    @classmethod
    def read(cls, kept: Kept) -> EpisodeTable:
        table = read_episodes(kept.path)
        return cls(kept, table, _rows_of(table["episode_index"].to_pylist(), kept.wanted, kept.path))

    def videos(self, camera: str) -> dict[int, Path]:
        """The video of each wanted episode; none where the table does not say."""
        if f"videos/{camera}/{_OF_VIDEO[-1]}" not in self.table.column_names:
            return {}
        places = [self.table[f"videos/{camera}/{name}"].to_pylist() for name in _OF_VIDEO[:2]]
        names = {m: (places[0][row], places[1][row]) for m, row in self.row_of.items()}
        return {m: video_place(self.kept.path, self.kept.info, camera, *name) for m, name in names.items()}

    def prepare(self, videos: Videos) -> None:
        """Nothing: times begin at 0 in each episode."""

    def write(self, videos: Videos, gone: Sequence[str]) -> list[ByFeature]:
        """Write the rows about the kept episodes, with their new numbers and places, and their videos.

        The statistics of each episode are returned.
        """
        import pyarrow.parquet as pq

        kept = self.kept
        table = self.table.take([self.row_of[m] for m in kept.numbers])
        of_gone = tuple(f"{what}/{camera}/" for camera in gone for what in ("videos", "stats"))
        table = table.drop_columns([name for name in table.column_names if name.startswith(of_gone)])
        numbers = list(kept.numbers.values())
        lengths = [kept.lengths[m] for m in numbers]
        ends = np.cumsum(lengths)
        values: dict[str, Sequence[object]] = {
            "episode_index": numbers,
            "length": lengths,
            "dataset_from_index": (ends - lengths).tolist(),
            "dataset_to_index": ends.tolist(),
            "data/chunk_index": [kept.files[m][0] for m in numbers],
            "data/file_index": [kept.files[m][1] for m in numbers],
            "meta/episodes/chunk_index": [0] * len(numbers),
            "meta/episodes/file_index": [0] * len(numbers),
        }
        for camera, files in videos.items():
            values |= self._copy_videos(camera, table, files)
        columns = [name.removeprefix("stats/").rpartition("/") for name in table.column_names if name[:6] == "stats/"]
        read = {column: table[f"stats/{''.join(column)}"].to_pylist() for column in columns}
        found: list[ByFeature] = [defaultdict(dict) for _ in numbers]
        for (feature, _, name), cells in read.items():
            for one, cell in zip(found, cells, strict=True):
                one[feature][name] = cell
        _renew(kept, found)
        values |= {f"stats/{feature}/{name}": [one[feature][name] for one in found] for feature, _, name in columns}
        for name in values.keys() & set(table.column_names):
            table = with_column(table, name, values[name])
        target = kept.new / _EPISODES
        target.parent.mkdir(parents=True)
        pq.write_table(table, target)
        return found

    def _copy_videos(self, camera: str, table: pa.Table, files: Mapping[int, Path]) -> dict[str, Sequence[object]]:
        """Write the videos of a camera; the columns that say where each episode lies in them.

        A file of which all episodes are kept whole is copied; of others, the frames of the kept ones.
        """
        kept, size = self.kept, int(self.kept.info["chunks_size"])
        names = [f"videos/{camera}/{name}" for name in _OF_VIDEO]
        n_in_file = Counter(zip(*(self.table[name].to_pylist() for name in names[:2]), strict=True))
        chunks, numbers, starts, ends = (table[name].to_pylist() for name in names)
        rows_of: dict[tuple[int, int], list[int]] = defaultdict(list)
        for row, place in enumerate(zip(chunks, numbers, strict=True)):
            rows_of[place].append(row)
        olds, lengths = list(kept.numbers), table["length"].to_pylist()
        for number, (place, rows) in enumerate(rows_of.items()):
            target = kept.new / kept.target(1, *divmod(number, size), camera)
            target.parent.mkdir(parents=True, exist_ok=True)
            source, whole = files[olds[rows[0]]], len(rows) == n_in_file[place]
            if whole and not any(str(olds[row]) in kept.trims for row in rows):
                shutil.copyfile(source, target)
            else:
                spans = []
                for row in rows:
                    first, end = kept.trims.get(str(olds[row]), (0, lengths[row]))
                    last = ends[row] if end >= lengths[row] else min(ends[row], starts[row] + end / kept.fps)
                    spans.append((starts[row] + first / kept.fps, last))
                for row, span, start in zip(rows, spans, video.cut(source, target, spans, kept.fps), strict=True):
                    starts[row], ends[row] = start, start + span[1] - span[0]
            for row in rows:
                chunks[row], numbers[row] = divmod(number, size)
        return dict(zip(names, (chunks, numbers, starts, ends), strict=True))


def _renew(kept: Kept, found: Sequence[ByFeature]) -> None:
    """Shift the statistics of numbers that are counted again, and compute those of trimmed episodes."""
    start = 0
    for (old, new), own in zip(kept.numbers.items(), found, strict=True):
        for feature, number in (("episode_index", new), ("index", start)):
            if feature in own:
                own[feature] = stats.shifted(own[feature], number - np.ravel(own[feature]["min"])[0].item())
        start += kept.lengths[new]
        if str(old) in kept.trims:
            own |= stats.of_table(kept.rows(new), own)


@dataclass(frozen=True, eq=False)
class EpisodeLines:
    """Those of versions 2.0 and 2.1: each episode has its own data file and videos."""

    kept: Kept
    rows: Mapping[int, dict[str, Parsed]]

    @classmethod
    def read(cls, kept: Kept) -> EpisodeLines:
        rows = read_lines(kept.path / "meta" / "episodes.jsonl")
        row_of = _rows_of([row["episode_index"] for row in rows], kept.wanted, kept.path)
        return cls(kept, {m: rows[row] for m, row in row_of.items()})

    def videos(self, camera: str) -> dict[int, Path]:
        """The video of each wanted episode."""
        size = int(self.kept.info["chunks_size"])
        return {m: video_place(self.kept.path, self.kept.info, camera, m // size, m) for m in self.rows}

    def prepare(self, videos: Videos) -> None:
        """Find where trimmed videos can begin: with a frame, the same in all cameras, that needs no other.

        Version 2 cannot say that an episode begins within its video, so that the times of its rows begin there.
        """
        fps = self.kept.fps
        for name, (first, _) in self.kept.trims.items():
            common = set(range(first + 1)) if int(name) in self.rows else set()
            for files in videos.values() if common else ():
                packets = video.Packets.of(files[int(name)])
                common &= set(np.rint(packets.times[packets.is_key] * fps).astype(int).tolist())
            self.kept.skipped[int(name)] = max(common, default=0) / fps

    def write(self, videos: Videos, gone: Sequence[str]) -> list[ByFeature]:
        """Write the lines about the kept episodes, with their new numbers, and their videos."""
        kept = self.kept
        for camera, files in videos.items():
            for old, new in kept.numbers.items():
                target = kept.new / kept.target(1, *kept.files[new], camera)
                target.parent.mkdir(parents=True, exist_ok=True)
                if str(old) in kept.trims:
                    span = kept.skipped[old], kept.trims[str(old)][1] / kept.fps
                    video.cut(files[old], target, [span], kept.fps)
                else:
                    shutil.copyfile(files[old], target)
        lines = [
            self.rows[old] | {"episode_index": new, "length": kept.lengths[new]} for old, new in kept.numbers.items()
        ]
        _write_lines(kept.new / "meta" / "episodes.jsonl", lines)
        place = kept.path / "meta" / "episodes_stats.jsonl"
        by_old = {int(row["episode_index"]): row["stats"] for row in read_lines(place)} if place.is_file() else {}
        if not by_old:
            return []
        found = [{name: one for name, one in by_old[old].items() if name not in gone} for old in kept.numbers]
        _renew(kept, found)
        lines = [{"episode_index": new, "stats": own} for new, own in zip(kept.numbers.values(), found, strict=True)]
        _write_lines(kept.new / "meta" / "episodes_stats.jsonl", lines)
        return found


def read_lines(place: Path) -> list[dict[str, Parsed]]:
    """What the lines of JSON in a file hold."""
    return parse_lines(read_text(place, LARGEST_TABLE), str(place), LARGEST_TABLE)


def _write_lines(place: Path, rows: Sequence[Mapping[str, Parsed]]) -> None:
    place.write_text("".join(f"{json.dumps(row)}\n" for row in rows), encoding="utf-8")
