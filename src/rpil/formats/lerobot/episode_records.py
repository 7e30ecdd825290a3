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
from rpil.formats.format import Shot
from rpil.formats.lerobot import stats, video
from rpil.formats.lerobot.kept import Kept
from rpil.formats.parquet_file import read_table

if TYPE_CHECKING:
    import pyarrow as pa

ByFeature = dict[str, dict[str, Parsed]]
"""The statistics of one episode."""

Videos = Mapping[str, Mapping[int, Shot]]
"""Where each camera saw each episode."""

_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_STATISTICS = "episodes_stats.jsonl"


def read_episodes(path: Path) -> pa.Table:
    """The table of the episodes of a folder of version 3.0; a `DataError` where there is none."""
    import pyarrow as pa

    files = sorted((path / "meta" / "episodes").rglob("*.parquet"))
    if not files:
        raise DataError(f"{path}: meta/episodes has no table of the episodes; download it again.")
    return pa.concat_tables(map(read_table, files), promote_options="permissive")


def read_lines(place: Path) -> list[dict[str, Parsed]]:
    """What the lines of JSON in a file hold."""
    return parse_lines(read_text(place, LARGEST_TABLE), str(place), LARGEST_TABLE)


@dataclass(frozen=True, eq=False)
class Episodes:
    """What ``meta`` says of the wanted episodes, by their old numbers."""

    kept: Kept
    rows: Mapping[int, dict[str, Parsed]]
    statistics: Mapping[int, ByFeature]
    """Empty where it has none by episode."""
    schema: pa.Schema | None
    """Of the table of version 3.0; None before."""

    @classmethod
    def read(cls, kept: Kept) -> Episodes:
        """Those of the old folder; a `DataError` where ``meta`` does not list a wanted episode."""
        import pyarrow as pa

        meta, schema, statistics = kept.path / "meta", None, dict[int, ByFeature]()
        if kept.is_v3:
            table = read_episodes(kept.path)
            mask = [str(name) in kept.wanted for name in table["episode_index"].to_pylist()]
            rows, schema = table.filter(pa.array(mask, pa.bool_())).to_pylist(), table.schema
        else:
            rows = read_lines(meta / "episodes.jsonl")
        by_number = {int(row["episode_index"]): row for row in rows if str(row["episode_index"]) in kept.wanted}
        missing = sorted(kept.wanted - set(map(str, by_number)))
        if missing:
            raise DataError(
                f"{kept.path}, demonstration {missing[0]}: it is not in meta/episodes; repair the data set."
            )
        if kept.is_v3:
            statistics = {m: _by_feature(row) for m, row in by_number.items()}
        elif (meta / _STATISTICS).is_file():
            statistics = {int(row["episode_index"]): row["stats"] for row in read_lines(meta / _STATISTICS)}
        return cls(kept, by_number, statistics, schema)

    def names_places(self, camera: str) -> bool:
        """Whether the table says where in the videos of a camera each episode lies; before version 3.0 it need not."""
        return self.schema is None or f"videos/{camera}/to_timestamp" in self.schema.names

    def write(self, videos: Videos, files: Counter[Path], gone: Sequence[str]) -> list[ByFeature]:
        """Write what is said of the kept episodes, with their new numbers and places, and their videos.

        `files` has the number of episodes in each old video, and `gone` the cameras that are left out. Returned are the
        statistics of each episode, if there are any.
        """
        kept, meta, start = self.kept, self.kept.new / "meta", 0
        found: list[ByFeature] = []
        for old, new in kept.numbers.items():
            n = kept.lengths[new]
            self.rows[old].update(episode_index=new, length=n)
            if kept.is_v3:
                self.rows[old].update(dataset_from_index=start, dataset_to_index=start + n)
                for name, places in {"data": kept.files[new], "meta/episodes": (0, 0)}.items():
                    self.rows[old] |= {f"{name}/chunk_index": places[0], f"{name}/file_index": places[1]}
            if self.statistics:
                own = {name: one for name, one in self.statistics[old].items() if name not in gone}
                found.append(_renewed(kept, old, start, own))
            start += n
        for camera, shots in videos.items():
            self._copy_videos(camera, [shots[old] for old in kept.numbers], files)
        rows = [self.rows[old] for old in kept.numbers]
        if self.schema is not None:
            _write_table(kept.new / _EPISODES, rows, found, self.schema, gone)
            return found
        _write_lines(meta / "episodes.jsonl", rows)
        if found:
            _write_lines(meta / _STATISTICS, [{"episode_index": new, "stats": own} for new, own in enumerate(found)])
        return found

    def _copy_videos(self, camera: str, shots: Sequence[Shot], files: Counter[Path]) -> None:
        """Write the videos of a camera, and say where in them each episode lies.

        A file of which all episodes are kept whole is copied; of others, the frames of the kept ones.
        """
        kept, by_file = self.kept, defaultdict[Path, list[Shot]](list)
        for shot in shots:
            by_file[shot.path].append(shot)
        for number, (source, own) in enumerate(by_file.items()):
            place = kept.place_of(number)
            target = kept.target(1, *place, camera)
            target.parent.mkdir(parents=True, exist_ok=True)
            spans = [(shot.start, shot.end) for shot in own]
            if len(own) == files[source] and not any(str(shot.episode) in kept.cuts for shot in own):
                shutil.copyfile(source, target)
            else:
                parts = [kept.span(shot) for shot in own]
                starts = video.cut(source, target, parts, kept.fps)
                spans = [(start, start + b - a) for start, (a, b) in zip(starts, parts, strict=True)]
            for shot, (start, end) in zip(own if kept.is_v3 else (), spans, strict=kept.is_v3):
                said = {"chunk_index": place[0], "file_index": place[1], "from_timestamp": start, "to_timestamp": end}
                self.rows[shot.episode] |= {f"videos/{camera}/{name}": value for name, value in said.items()}


def _by_feature(row: Mapping[str, Parsed]) -> ByFeature:
    """The statistics in a row of the table."""
    found: ByFeature = defaultdict(dict)
    for column in row:
        if column.startswith("stats/"):
            feature, _, name = column.removeprefix("stats/").rpartition("/")
            found[feature][name] = row[column]
    return found


def _renewed(kept: Kept, old: int, start: int, own: ByFeature) -> ByFeature:
    """Statistics of an episode that begins at step `start`: shifted where numbers are counted again, or new ones."""
    new = kept.numbers[old]
    for feature, number in (("episode_index", new), ("index", start)):
        if feature in own:
            own[feature] = stats.shifted(own[feature], number - np.ravel(own[feature]["min"])[0].item())
    return own | (stats.of_table(kept.rows(new), own) if str(old) in kept.cuts else {})


def _write_table(
    target: Path, rows: Sequence[dict[str, Parsed]], found: Sequence[ByFeature], schema: pa.Schema, gone: Sequence[str]
) -> None:
    """Write the table of version 3.0 with its old columns but for those of cameras that are left out."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    of_gone = tuple(f"{what}/{camera}/" for camera in gone for what in ("videos", "stats"))
    schema = pa.schema([field for field in schema if not field.name.startswith(of_gone)], schema.metadata)
    for row, own in zip(rows, found, strict=True):
        row |= {f"stats/{feature}/{name}": value for feature, one in own.items() for name, value in one.items()}
    target.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(rows, schema), target)


def _write_lines(place: Path, rows: Sequence[Mapping[str, Parsed]]) -> None:
    place.write_text("".join(f"{json.dumps(row)}\n" for row in rows), encoding="utf-8")
