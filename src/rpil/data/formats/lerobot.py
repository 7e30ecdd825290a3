"""LeRobot's ``meta`` folder beside the data: frames a second, names of joints, tasks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from rpil.data.folders import check_inside
from rpil.data.formats.parquet_pages import check_table
from rpil.data.json_files import LARGEST_METADATA, parse, parse_lines

if TYPE_CHECKING:
    from pyarrow import fs


@dataclass(frozen=True)
class Metadata:
    """What ``meta`` says of the data; empty where there is none."""

    version: str = ""
    fps: float | None = None
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # of the numbers in a column of lists
    tasks: Mapping[str, str] = field(default_factory=dict)  # by task_index, as text
    videos: tuple[str, ...] = ()  # observations that lie beside the table
    sizes: Mapping[str, object] = field(default_factory=dict)  # declared numbers of demonstrations and steps

    def notes(self, n_demonstrations: int, n_steps: int) -> tuple[str, ...]:
        """What ``meta`` says otherwise than the data, in sentences."""
        found = {"total_episodes": (n_demonstrations, "demonstrations"), "total_frames": (n_steps, "steps")}
        return tuple(
            f"meta/info.json says {name} = {self.sizes[name]}, but the data hold {n:,} {what}; the data are believed."
            for name, (n, what) in found.items()
            if self.sizes.get(name, n) != n
        )


def format_name(metadata: Metadata, n_files: int) -> str:
    """The format and version of a data set, and how many files it has."""
    name = f"LeRobot {metadata.version}" if metadata.version else "Parquet"
    return name if n_files == 1 else f"{name}, {n_files:,} files"


def read_metadata(filesystem: fs.FileSystem, path: str) -> Metadata:
    """The metadata of the data set that holds the data file `path`; empty where it cannot be read."""
    from pyarrow import fs

    data = next((folder for folder in PurePosixPath(path).parents if folder.name == "data"), None)
    if data is None:
        return Metadata()
    meta = data.parent / "meta"
    if isinstance(filesystem, fs.LocalFileSystem):
        for name in ("info.json", "tasks.parquet", "tasks.jsonl"):
            check_inside(str(meta / name), str(data.parent))
    try:
        with filesystem.open_input_stream(str(meta / "info.json")) as stream:
            info = parse(stream.read(LARGEST_METADATA + 1), str(meta / "info.json"))
        features = info.get("features", {})
        names = {name: parts for name, feature in features.items() if (parts := _part_names(feature))}
        videos = tuple(name for name, feature in features.items() if feature.get("dtype") == "video")
        fps = float(info["fps"]) if info.get("fps") else None
        sizes = {name: info[name] for name in ("total_episodes", "total_frames") if name in info}
        return Metadata(str(info.get("codebase_version", "")), fps, names, _tasks(filesystem, meta), videos, sizes)
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):  # the data can be read without it
        return Metadata()


def _part_names(feature: Mapping[str, object]) -> tuple[str, ...]:
    names = feature.get("names")
    if isinstance(names, dict):  # version 2 has {"motors": [...]}
        names = next(iter(names.values()), None)
    return tuple(map(str, names)) if isinstance(names, list) and feature.get("shape") == [len(names)] else ()


def _tasks(filesystem: fs.FileSystem, meta: PurePosixPath) -> dict[str, str]:
    """Task by its number: a table since version 3, where its texts are the index of pandas; lines of JSON before."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        check_table(str(meta / "tasks.parquet"), filesystem)
        with filesystem.open_input_file(str(meta / "tasks.parquet")) as file:
            table = pq.read_table(file)
        text = next((name for name in table.column_names if name != "task_index"), "task_index")
        return dict(zip(map(str, table["task_index"].to_pylist()), map(str, table[text].to_pylist()), strict=True))
    except FileNotFoundError:
        pass
    except (pa.ArrowException, KeyError):
        return {}
    try:
        with filesystem.open_input_stream(str(meta / "tasks.jsonl")) as stream:
            rows = parse_lines(stream.read(LARGEST_METADATA + 1), str(meta / "tasks.jsonl"))
        return {str(row["task_index"]): str(row["task"]) for row in rows}
    except (OSError, KeyError, TypeError):
        return {}
