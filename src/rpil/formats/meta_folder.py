"""LeRobot's ``meta`` folder, which may lie beside Parquet files: frames a second, names of joints, tasks, lengths."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pyarrow as pa

from rpil.data.arrays import Id
from rpil.data.files import check_inside, is_hidden
from rpil.data.guard import guarded
from rpil.data.json_files import LARGEST_TABLE, Parsed, parse_lines, read_json, read_text
from rpil.formats.metadata import Metadata
from rpil.formats.parquet_file import read_table

_PLACE = re.compile(r"\{(\w+)(?::(0\dd))?\}")


@dataclass(frozen=True, eq=False)
class MetaFolder:
    """The folder ``meta`` in the folder at `path`, which no link may leave."""

    path: Path

    @cached_property
    def files(self) -> list[Path]:
        """Files in it; a `DataError` where a link leads out of the folder, or to nothing."""
        inside = ((Path(folder), [*folders, *files]) for folder, folders, files in os.walk(self.path / "meta"))
        found = sorted(folder / name for folder, names in inside for name in names)
        for place in found:
            if not is_hidden(place.name):
                check_inside(place, self.path)
        return found

    @cached_property
    def info(self) -> dict[str, Parsed]:
        """The content of ``info.json``; empty where it is not there, and a `DataError` where it is damaged."""
        place, name = self.path / "meta" / "info.json", f"{self.path.name}/meta/info.json"
        if place not in self.files:
            return {}
        with guarded(name, "it does not describe a data set", "write it again, or move it away"):
            if isinstance(info := read_json(place), dict):
                return info
            raise TypeError("no object")

    def tables(self, name: str) -> list[Path]:
        """The Parquet files of a table, in order."""
        first = (place.relative_to(self.path / "meta").parts[0] for place in self.files)
        own = (place for place, part in zip(self.files, first, strict=True) if part in (name, f"{name}.parquet"))
        return [place for place in own if place.suffix == ".parquet"]

    def rows(self, name: str, wanted: Callable[[str], bool] = lambda _: True) -> list[dict[str, Parsed]]:
        """The rows of a table: of lines of JSON before version 3.0, of Parquet files since; none where it is not there.

        Of Parquet files the columns that are `wanted` are given. Errors of reading are left as they are.
        """
        lines = self.path / "meta" / f"{name}.jsonl"
        if lines in self.files:
            return parse_lines(read_text(lines, LARGEST_TABLE), str(lines), LARGEST_TABLE)
        tables = [read_table(place) for place in self.tables(name)]
        return [row for one in tables for row in one.select([*filter(wanted, one.column_names)]).to_pylist()]

    @cached_property
    def lengths(self) -> dict[Id, int]:
        """Steps by episode; empty where it does not say, and a `DataError` where it is damaged."""
        with guarded(self.path / "meta", "it does not say how long each episode is", "write it again"):
            rows = self.rows("episodes", lambda name: name in ("episode_index", "length"))
            return {int(row["episode_index"]): int(row["length"]) for row in rows}

    def tasks(self) -> dict[str, str]:
        """Task by its number; since version 3.0 its text is the index of pandas. Empty where they are damaged."""
        found = {}
        with suppress(pa.ArrowException, OSError, ValueError, KeyError, TypeError, RecursionError):
            for row in self.rows("tasks"):
                texts = [text for name, text in row.items() if name != "task_index"]
                found[str(row["task_index"])] = str(row.get("task", *texts[:1]))
        return found


def read_metadata(paths: Sequence[str]) -> Metadata:
    """The metadata of the data set that holds the data files `paths`; empty where there are none.

    Lengths are those of all demonstrations, and empty where `paths` are some of the files only. A `DataError` where
    ``info.json`` or the table of lengths is damaged; a value of ``info.json`` that cannot be used is left out.
    """
    data = next((folder for folder in Path(paths[0]).parents if folder.name == "data"), None)
    meta = None if data is None else MetaFolder(data.parent)
    if data is None or meta is None or not meta.info:
        return Metadata()
    info = meta.info
    features = info.get("features")
    features = features if isinstance(features, dict) else {}
    shown = {str(file) for file in data.rglob("*.parquet") if not file.name.startswith((".", "_"))}
    return Metadata(
        version=str(info.get("codebase_version", ""))[:40],
        fps=frame_rate(info.get("fps")),
        names={m: parts for m, one in features.items() if isinstance(one, dict) and (parts := _part_names(one))},
        tasks=meta.tasks(),
        videos=cameras(info, "video"),
        n_cameras=len(cameras(info, "video", "image")),
        lengths=meta.lengths if shown <= {*paths} else {},
    )


def frame_rate(value: Parsed) -> float | None:
    """The number that a value or a text says, as frames a second; None where it is none above 0."""
    with suppress(ValueError, TypeError, OverflowError):
        return float(value) if not isinstance(value, bool) and 0 < float(value) < 1e9 else None
    return None


def fill(template: str, chunk: int, file: int, camera: str = "") -> str:
    """A path of ``info.json``, as data/chunk-{chunk_index:03d}, with the numbers of a chunk and of a file in it."""
    values: dict[str, object] = {"chunk_index": chunk, "file_index": file, "video_key": camera}
    values |= {"episode_chunk": chunk, "episode_index": file}
    return _PLACE.sub(lambda match: format(values[match[1]], match[2] or ""), template)


def cameras(info: Mapping[str, Parsed], *kinds: str) -> tuple[str, ...]:
    """The features of these kinds, "video" or "image", that ``info.json`` names."""
    features = info.get("features")
    features = features if isinstance(features, dict) else {}
    return tuple(name for name, of in features.items() if isinstance(of, dict) and of.get("dtype") in kinds)


def chunk_size(info: Mapping[str, Parsed]) -> int | None:
    """Files in a folder of data; None where ``info.json`` has no whole number above 0 for it."""
    size = frame_rate(info.get("chunks_size", 1000))
    return int(size) if size is not None and size.is_integer() else None


def _part_names(feature: Mapping[str, object]) -> tuple[str, ...]:
    names = feature.get("names")
    if isinstance(names, dict):  # version 2 has {"motors": [...]}
        names = next(iter(names.values()), None)
    if isinstance(names, list) and len(names) == 1 and isinstance(names[0], list):  # of Unitree's converter
        names = names[0]
    return tuple(map(str, names)) if isinstance(names, list) and feature.get("shape") == [len(names)] else ()
