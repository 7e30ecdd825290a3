"""LeRobot's ``meta`` folder, which may lie beside Parquet files: frames a second, names of joints, tasks, lengths."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePosixPath
from typing import TypeGuard

import pyarrow as pa
from pyarrow import fs

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.folders import check_inside, is_hidden
from rpil.data.guard import guarded
from rpil.data.json_files import LARGEST_METADATA, LARGEST_TABLE, Parsed, parse, parse_lines
from rpil.data.names import quoted
from rpil.formats.metadata import SIZES, Metadata
from rpil.formats.parquet_file import input_file, read_table

_PLACE = re.compile(r"\{(\w+)(?::(0\dd))?\}")
_NO_FACT = re.compile(r"(?:stats|videos|data|meta)/.*|dataset_.*|tasks?|task_index")
"""Columns of the table of episodes that say nothing of a demonstration."""


@dataclass(frozen=True)
class MetaFolder:
    """The folder ``meta`` in the folder `top`, which no link may leave."""

    filesystem: fs.FileSystem
    top: PurePosixPath

    @cached_property
    def files(self) -> list[PurePosixPath]:
        """The entries of the folder; a `DataError` where a link leads out of the folder, or to nothing."""
        selector = fs.FileSelector(str(self.top / "meta"), recursive=True, allow_not_found=True)
        found = sorted(PurePosixPath(info.path) for info in self.filesystem.get_file_info(selector))
        for place in found if isinstance(self.filesystem, fs.LocalFileSystem) else ():
            if not is_hidden(place.name):
                check_inside(str(place), str(self.top))
        return found

    def _text(self, place: PurePosixPath, limit: int) -> bytes:
        """As much of a file as its kind has at most, and a byte more."""
        with input_file(self.filesystem, place) as stream:
            return bytes(stream.read_at(limit + 1, 0))

    @cached_property
    def info(self) -> dict[str, Parsed]:
        """The content of ``info.json``; empty where it is not there, and a `DataError` where it is damaged."""
        place, name = self.top / "meta" / "info.json", f"{self.top.name}/meta/info.json"
        if place not in self.files:
            return {}
        with guarded(place, remedy="change its permissions, or move it away"):
            text = self._text(place, LARGEST_METADATA)
        with guarded(name, "it does not describe a data set", "write it again, or move it away"):
            if isinstance(info := parse(text, name), dict):
                return info
            raise TypeError("no object")

    def tables(self, name: str) -> list[PurePosixPath]:
        """The Parquet files of a table, in order."""
        parts = [(place, place.relative_to(self.top / "meta").parts[0]) for place in self.files]
        own = (place for place, first in parts if first in (name, f"{name}.parquet"))
        return sorted(place for place in own if place.suffix == ".parquet")

    def rows(self, name: str, wanted: Callable[[str], bool] = lambda _: True) -> list[dict[str, Parsed]]:
        """The rows of a table: of lines of JSON before version 3.0, of Parquet files since; none where it is not there.

        Of Parquet files the columns that are `wanted` are given. Errors of reading are left as they are.
        """
        lines = self.top / "meta" / f"{name}.jsonl"
        if lines in self.files:
            return parse_lines(self._text(lines, LARGEST_TABLE), str(lines), LARGEST_TABLE)
        rows: list[dict[str, Parsed]] = []
        for place in self.tables(name):
            table = read_table(place, None, self.filesystem)
            rows += table.select([*filter(wanted, table.column_names)]).to_pylist()
        return rows

    @cached_property
    def lengths(self) -> dict[Id, int]:
        """Steps by episode; empty where it does not say, and a `DataError` where it is damaged."""
        with guarded(self.top / "meta", "it does not say how long each episode is", "write it again"):
            return {int(row["episode_index"]): int(row["length"]) for row in self.episodes}

    @cached_property
    def episodes(self) -> list[dict[str, Parsed]]:
        """The statements on each episode, without statistics and places."""
        return self.rows("episodes", lambda name: not _NO_FACT.fullmatch(name))

    def facts(self) -> dict[str, dict[str, Parsed]]:
        """The columns with a text or number for an episode, which has its number, as text."""
        found: dict[str, dict[str, Parsed]] = {}
        for row in self.episodes:
            for name, value in row.items():
                if isinstance(value, str | int | float) and not _NO_FACT.fullmatch(name):
                    found.setdefault(name, {})[str(row["episode_index"])] = value
        return {name: one for name, one in found.items() if name not in ("episode_index", "length")}

    def tasks(self) -> dict[str, str] | None:
        """Task by its number; since version 3.0 its text is the index of pandas. None where they are damaged."""
        try:
            found = {}
            for row in self.rows("tasks"):
                texts = [text for name, text in row.items() if name != "task_index"]
                found[str(row["task_index"])] = str(row.get("task", *texts[:1]))
            return found
        except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, RecursionError):
            return None

    def listed(self, present: Sequence[str]) -> list[str]:
        """The data files `present` that it lists; all where it does not say, or lists none of them.

        Before version 3 each episode has a file, so that files of episodes which ``meta`` does not name are strays.
        """
        template, size = self.info.get("data_path"), chunk_size(self.info)
        if isinstance(template, str) and "episode_index" in template and size is not None:
            with suppress(KeyError, ValueError):
                names = {fill(template, int(m) // size, int(m)) for m in self.lengths}
                return [place for place in present if place in names] or list(present)
        return list(present)


def choose_files(filesystem: fs.FileSystem, where: str, place: str, files: list[str]) -> list[str]:
    """The data among the Parquet `files` in the folder `place`, which may be LeRobot's ``data``, without strays.

    A `DataError` that names `where` if ``meta`` is there and the data are not.
    """
    folder = PurePosixPath(place)
    meta = MetaFolder(filesystem, folder.parent if folder.name == "data" else folder)
    by_place = {str(PurePosixPath(file).relative_to(meta.top)): file for file in files}
    own = [place for place in by_place if not place.startswith("meta/")]
    try:
        if not meta.info:
            return files
        listed = meta.listed(own)
    except DataError:  # the reader names what is damaged, after the data
        return files
    if not own and "codebase_version" in meta.info:
        n = str(meta.info.get("total_episodes", "?"))[:20]
        raise DataError(
            f"{where}: meta/info.json describes a data set of LeRobot of {n} episodes, and no Parquet file is in data; "
            "download it again, or record some."
        )
    return [by_place[place] for place in listed]


def read_metadata(filesystem: fs.FileSystem, paths: Sequence[str]) -> Metadata:
    """The metadata of the data set that holds the data files `paths`; empty where there are none.

    Lengths are those of all demonstrations, and empty where `paths` are some of the files only. A `DataError` where
    ``info.json`` or the table of lengths is damaged; a value of ``info.json`` that cannot be used is left out.
    """
    data = next((folder for folder in PurePosixPath(paths[0]).parents if folder.name == "data"), None)
    meta = None if data is None else MetaFolder(filesystem, data.parent)
    if data is None or meta is None or not meta.info:
        return Metadata()
    info = meta.info | {name: _number(meta.info[name]) for name in ("fps", *SIZES) if name in meta.info}
    fps, given, tasks = frame_rate(info.get("fps")), info.get("features", {}), meta.tasks()
    features = {k: v for k, v in given.items() if isinstance(v, dict)} if isinstance(given, dict) else {}
    wrong = [name for name in given if name not in features] if isinstance(given, dict) else []
    sizes: dict[str, float] = {name: info[name] for name in SIZES if _is_size(info.get(name))}
    is_usable = {
        f"fps = {str(info.get('fps'))[:40]!r}": fps == info.get("fps"),
        f"features {quoted(wrong, 5)}".strip(): features == given,
        **{name: name in sizes for name in SIZES if name in info},
        "chunks_size": chunk_size(info) is not None,
        "tasks": tasks is not None,
    }
    infos = filesystem.get_file_info(fs.FileSelector(str(data), recursive=True))
    places = (PurePosixPath(one.path).relative_to(data.parent) for one in infos)
    present = [str(file) for file in places if file.suffix == ".parquet" and not file.name.startswith((".", "_"))]
    listed, read = {*meta.listed(present)}, {str(PurePosixPath(path).relative_to(data.parent)) for path in paths}
    return Metadata(
        version=str(info.get("codebase_version", ""))[:40],
        fps=fps,
        names={name: parts for name, feature in features.items() if (parts := _part_names(feature))},
        tasks=tasks or {},
        videos=cameras(info, "video"),
        n_cameras=len(cameras(info, "video", "image")),
        strays=tuple(sorted({*present} - listed - read)),
        sizes=sizes,
        lengths=meta.lengths if listed <= read else {},
        unusable=tuple(what for what, holds in is_usable.items() if not holds),
        facts=meta.facts(),
    )


def _is_size(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < 1e15


def frame_rate(value: object) -> float | None:
    """Frames a second; None where it is no number above 0."""
    return float(value) if _is_size(value) and 0 < value < 1e9 else None


def _number(value: Parsed) -> Parsed:
    """The number that a text says; any other value as it is."""
    with suppress(ValueError, TypeError):
        return float(value) if isinstance(value, str) else value
    return value


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
    size = _number(info.get("chunks_size", 1000))
    return int(size) if _is_size(size) and size >= 1 and size == int(size) else None


def _part_names(feature: Mapping[str, object]) -> tuple[str, ...]:
    names = feature.get("names")
    if isinstance(names, dict):  # version 2 has {"motors": [...]}
        names = next(iter(names.values()), None)
    if isinstance(names, list) and len(names) == 1 and isinstance(names[0], list):  # of Unitree's converter
        names = names[0]
    return tuple(map(str, names)) if isinstance(names, list) and feature.get("shape") == [len(names)] else ()
