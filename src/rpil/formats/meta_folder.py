"""LeRobot's ``meta`` folder, which may lie beside Parquet files: frames a second, names of joints, tasks, lengths."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.folders import check_inside
from rpil.data.guard import guarded
from rpil.data.held import held_bytes
from rpil.data.json_files import LARGEST_METADATA, LARGEST_TABLE, Parsed, parse, parse_lines
from rpil.data.names import quoted
from rpil.formats.metadata import SIZES, Metadata
from rpil.formats.parquet_file import input_file, read_table

if TYPE_CHECKING:
    from pyarrow import fs


_PLACE = re.compile(r"\{(\w+)(?::(0\dd))?\}")


def info_of(path: Path) -> dict[str, Parsed]:
    """What ``meta/info.json`` of a folder says; a `DataError` where it is damaged."""
    with held_bytes(path / "meta" / "info.json") as file:
        return read_info(file.read(LARGEST_METADATA + 1), path.resolve().name)


def read_info(text: str | bytes, folder: str) -> dict[str, Parsed]:
    """The content of ``meta/info.json`` in a `folder`; a `DataError` that names the file, if it is damaged."""
    where = f"{folder}/meta/info.json", "it does not describe a data set", "write it again, or move it away"
    with guarded(*where):
        info = parse(text, where[0])
        if isinstance(info, dict):
            return info
        raise TypeError("no object")


def choose_files(filesystem: fs.FileSystem, where: str, place: str, files: list[str]) -> list[str]:
    """The data among the Parquet `files` in the folder `place`, which may be LeRobot's ``data``, without strays.

    A `DataError` that names `where` if ``meta`` is there and the data are not.
    """
    top = PurePosixPath(place)
    meta = (top.parent if top.name == "data" else top) / "meta"
    try:
        info = read_info(_read_start(filesystem, meta / "info.json"), meta.parent.name)
        is_one_each = "episode_index" in str(info.get("data_path"))
        lengths = _lengths(filesystem, meta) if is_one_each else {}
    except (FileNotFoundError, DataError):  # the reader names what is damaged, after the data
        return files
    own = [file for file in files if meta not in PurePosixPath(file).parents]
    if not own and "codebase_version" in info:
        n = str(info.get("total_episodes", "?"))[:20]
        raise DataError(
            f"{where}: meta/info.json describes a data set of LeRobot of {n} episodes, and no Parquet file is in data; "
            "download it again, or record some."
        )
    by_place = {str(PurePosixPath(file).relative_to(meta.parent)): file for file in own}
    return [by_place[file] for file in listed_files(info, lengths, list(by_place))]


def read_metadata(filesystem: fs.FileSystem, paths: Sequence[str]) -> Metadata:
    """The metadata of the data set that holds the data files `paths`; empty where there are none.

    Lengths are those of all demonstrations, and empty where `paths` are some of the files only. A `DataError` where
    ``info.json`` or the table of lengths is damaged; a value of ``info.json`` that cannot be used is left out.
    """
    from pyarrow import fs

    data = next((folder for folder in PurePosixPath(paths[0]).parents if folder.name == "data"), None)
    if data is None:
        return Metadata()
    meta = data.parent / "meta"
    if isinstance(filesystem, fs.LocalFileSystem):
        folder = fs.FileSelector(str(meta / "episodes"), recursive=True, allow_not_found=True)
        names = [meta / name for name in ("info.json", "tasks.parquet", "tasks.jsonl", "episodes.jsonl")]
        for place in (*names, meta / "episodes", *(info.path for info in filesystem.get_file_info(folder))):
            check_inside(str(place), str(data.parent))
    try:
        text = _read_start(filesystem, meta / "info.json")
    except FileNotFoundError:
        return Metadata()
    info, unusable = read_info(text, data.parent.name), []
    info |= {name: _number(info[name]) for name in ("fps", *SIZES) if name in info}
    fps = frame_rate(info.get("fps"))
    if fps != info.get("fps"):
        unusable.append(f"fps = {str(info['fps'])[:40]!r}")
    given = info.get("features", {})
    features = {k: v for k, v in given.items() if isinstance(v, dict)} if isinstance(given, dict) else {}
    if features != given:
        wrong = [name for name in given if name not in features] if isinstance(given, dict) else []
        unusable.append(f"features {quoted(wrong, 5)}" if wrong else "features")
    sizes: dict[str, float] = {name: info[name] for name in SIZES if _is_size(info.get(name))}
    unusable += [name for name in SIZES if name in info and name not in sizes]
    unusable += ["chunks_size"] * (chunk_size(info) is None)
    lengths = _lengths(filesystem, meta)
    strays, are_all = _strays(filesystem, data, info, lengths, paths)
    tasks = _tasks(filesystem, meta)
    unusable += ["tasks"] * (tasks is None)
    return Metadata(
        version=str(info.get("codebase_version", ""))[:40],
        fps=fps,
        names={name: parts for name, feature in features.items() if (parts := _part_names(feature))},
        tasks=tasks or {},
        videos=cameras(info, "video"),
        n_cameras=len(cameras(info, "video", "image")),
        strays=strays,
        sizes=sizes,
        lengths=lengths if are_all else {},
        unusable=tuple(unusable),
    )


def _read_start(filesystem: fs.FileSystem, path: PurePosixPath) -> bytes:
    """As much of a file as metadata have; a `FileNotFoundError` where it is not there."""
    remedy = "change its permissions, or move it away"
    with (
        guarded(path, remedy=remedy),
        suppress(FileNotFoundError),
        input_file(filesystem, path) as stream,
    ):
        return bytes(stream.read_at(LARGEST_METADATA + 1, 0))
    raise FileNotFoundError(path)


def _is_size(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < 1e15


def frame_rate(value: object) -> float | None:
    """Frames a second; None where it is no number above 0."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    return float(value) if 0 < value < 1e9 else None


def _strays(
    filesystem: fs.FileSystem,
    data: PurePosixPath,
    info: Mapping[str, Parsed],
    lengths: Mapping[Id, int],
    paths: Sequence[str],
) -> tuple[tuple[str, ...], bool]:
    """The data files that are not among `paths` nor listed by ``meta``, and whether `paths` are all the others."""
    from pyarrow import fs

    infos = filesystem.get_file_info(fs.FileSelector(str(data), recursive=True))
    places = (PurePosixPath(info.path).relative_to(data.parent) for info in infos)
    present = [str(file) for file in places if file.suffix == ".parquet" and not file.name.startswith((".", "_"))]
    others = set(present) - {str(PurePosixPath(path).relative_to(data.parent)) for path in paths}
    strays = others - set(listed_files(info, lengths, present))
    return tuple(sorted(strays)), others == strays


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


def listed_files(info: Mapping[str, Parsed], lengths: Mapping[Id, int], present: Sequence[str]) -> list[str]:
    """Those of the data files `present` that ``meta`` lists; all where it does not say, or lists none of them.

    Before version 3 each episode has a file, so that files of episodes which ``meta`` does not name are strays.
    """
    template, size = info.get("data_path"), chunk_size(info)
    if not isinstance(template, str) or "episode_index" not in template or size is None:
        return list(present)
    with suppress(KeyError, ValueError):
        names = {fill(template, int(m) // size, int(m)) for m in lengths}
        return [place for place in present if place in names] or list(present)
    return list(present)


def _lengths(filesystem: fs.FileSystem, meta: PurePosixPath) -> dict[Id, int]:
    """Steps by episode: of version 3 in ``episodes/``, before in ``episodes.jsonl``; empty where neither is there."""
    from pyarrow import fs

    with guarded(meta, "it does not say how long each episode is", "write it again"):
        try:
            with input_file(filesystem, meta / "episodes.jsonl") as stream:
                rows = parse_lines(stream.read_at(LARGEST_TABLE + 1, 0), str(meta / "episodes.jsonl"), LARGEST_TABLE)
        except FileNotFoundError:
            folder = fs.FileSelector(str(meta / "episodes"), recursive=True, allow_not_found=True)
            files = sorted(info.path for info in filesystem.get_file_info(folder) if info.path.endswith(".parquet"))
            wanted = ["episode_index", "length"]
            rows = [row for file in files for row in read_table(file, wanted, filesystem).to_pylist()]
        return {int(row["episode_index"]): int(row["length"]) for row in rows}


def _part_names(feature: Mapping[str, object]) -> tuple[str, ...]:
    names = feature.get("names")
    if isinstance(names, dict):  # version 2 has {"motors": [...]}
        names = next(iter(names.values()), None)
    if isinstance(names, list) and len(names) == 1 and isinstance(names[0], list):  # of Unitree's converter
        names = names[0]
    return tuple(map(str, names)) if isinstance(names, list) and feature.get("shape") == [len(names)] else ()


def _tasks(filesystem: fs.FileSystem, meta: PurePosixPath) -> dict[str, str] | None:
    """Task by its number: a table since version 3, where its texts are the index of pandas; lines of JSON before.

    Empty where there are none, None where they are damaged.
    """
    import pyarrow as pa

    try:
        with suppress(FileNotFoundError):
            table = read_table(meta / "tasks.parquet", None, filesystem)
            text = next((name for name in table.column_names if name != "task_index"), "task_index")
            return dict(zip(map(str, table["task_index"].to_pylist()), map(str, table[text].to_pylist()), strict=True))
        with suppress(FileNotFoundError), input_file(filesystem, meta / "tasks.jsonl") as stream:
            rows = parse_lines(stream.read_at(LARGEST_TABLE + 1, 0), str(meta / "tasks.jsonl"), LARGEST_TABLE)
            return {str(row["task_index"]): str(row["task"]) for row in rows}
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return {}
