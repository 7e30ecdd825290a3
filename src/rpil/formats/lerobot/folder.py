"""LeRobot's folders: what is kept as a list of episodes and as commands, or as a new folder with rows and videos."""

from __future__ import annotations

import json
import re
import shutil
from collections import defaultdict
from collections.abc import Mapping, Sequence, Set
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rpil.data.errors import DataError, guarded
from rpil.data.files import check_readable, copy_folder
from rpil.data.memory import Parsed, read_json
from rpil.formats import table_folder
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, Shot
from rpil.formats.lerobot import checked_folder
from rpil.formats.lerobot.checked_folder import DATA_PATH, VIDEO_PATH, CheckedFolder, EpisodeRows, rows_of_episodes
from rpil.formats.parquet import fill, frame_rate
from rpil.formats.parquet_file import read_table
from rpil.numerics.types import Array

_EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"


def claims(path: Path) -> bool:
    """Whether `path` is a folder with ``meta/info.json`` and ``data``."""
    return (path / "meta" / "info.json").is_file() and (path / "data").is_dir()


def unkept(path: Path, options: ColumnOptions) -> str:
    """Name of the folder in words, if `keep` writes no new one of it; empty where it writes one."""
    version = CheckedFolder(path).info.get("codebase_version")
    if version != "v3.0":
        return f"folder of LeRobot of version {str(version)[:20]!r}, which LeRobot converts to 3.0"
    return "folder by other ids than its own" if options.id else ""


def checked_info(folder: CheckedFolder) -> dict[str, Parsed]:
    """The content of ``meta/info.json``; a `DataError` where no new folder can be written by it."""
    info = folder.info
    with guarded(folder.path / checked_folder.INFO):
        wrong = [name for name in folder.cameras("video") if not re.fullmatch(r"\w[\w.-]*", name)]
        size, fps = frame_rate(info.get("chunks_size", 1000)), float(info["fps"])
        if wrong:
            raise ValueError(f"{wrong[0]!r} is no name of a camera")
        if size is None or not size.is_integer() or not 0 < fps < 1e9:
            raise ValueError("chunks_size is no whole number above 0, or fps none")
        info |= {"chunks_size": int(size), "fps": int(fps) if fps.is_integer() else fps}
    return info


def target(folder: Path, template: str, place: tuple[int, int], camera: str = "") -> Path:
    """The path of a new file, in a folder that is there."""
    path = folder / fill(template, *place, camera)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def write_episodes(
    old: CheckedFolder,
    new: Path,
    kept: Mapping[int, EpisodeRows],
    places: Mapping[str, tuple[int, int]],
    shots: Sequence[Shot],
    n_in_chunk: int,
) -> list[dict[str, Parsed]]:
    """Write what is said of the kept episodes, with their new numbers, and the `places` of their data, and the videos
    that have the `shots` of them. Returned is what is written of each episode, such as ``stats/action/min``."""
    rows = {int(row["episode_index"]): row for row in old.rows("episodes")}
    start, copied = 0, defaultdict[str, dict[str, tuple[int, int]]](dict)
    for number, (m, of_data) in enumerate(kept.items()):
        row, end = rows[m], start + of_data.n
        for name, first in {"index": start, "episode_index": number}.items():
            own = statistics_in(row, name)
            by = first - int(np.min(own.get("min", first)))
            row |= {f"stats/{name}/{k}": np.add(x, by).tolist() for k, x in own.items() if k not in ("std", "count")}
        row |= {"length": of_data.n, "dataset_from_index": start, "dataset_to_index": end, "episode_index": number}
        for name, place in {"data": places[of_data.file], "meta/episodes": (0, 0)}.items():
            row |= {f"{name}/chunk_index": place[0], f"{name}/file_index": place[1]}
        start = end
    for shot in shots:  # a file with any of these episodes is copied whole
        videos, file = copied[shot.camera], str(shot.path)
        if file not in videos:
            videos[file] = divmod(len(videos), n_in_chunk)
            shutil.copyfile(check_readable(file), target(new, VIDEO_PATH, videos[file], shot.camera))
        where = zip(("chunk_index", "file_index"), videos[file], strict=True)
        said = {**dict(where), "from_timestamp": shot.start, "to_timestamp": shot.end}
        rows[shot.episode] |= {f"videos/{shot.camera}/{name}": value for name, value in said.items()}
    found = [rows[m] for m in kept]
    pq.write_table(pa.Table.from_pylist(found, old.schema), target(new, _EPISODES, (0, 0)))
    return found


def statistics_in(row: Mapping[str, Parsed], feature: str) -> dict[str, Parsed]:
    """Statistics of a feature in a row of the table of episodes: min, max, mean, std, count, and quantiles as q01."""
    own = f"stats/{feature}"
    parts = ((column.rpartition("/"), value) for column, value in row.items() if value is not None)
    return {name: value for (place, _, name), value in parts if place == own}


def joined_stats(episodes: Sequence[Mapping[str, Parsed]]) -> dict[str, Parsed]:
    """Join the statistics of episodes, by their counts: of quantiles the mean, as LeRobot has it."""
    counts = np.array([np.ravel(one["count"])[0] for one in episodes], dtype=float)
    names = [name for name in episodes[0] if name != "count" and all(name in one for one in episodes)]
    values = {name: np.array([one[name] for one in episodes], dtype=float) for name in names}

    def average(of_each: Array) -> Array:
        return np.asarray(np.average(of_each, axis=0, weights=counts))

    by_name = {"min": np.min, "max": np.max}
    found = {name: by_name[name](x, axis=0) if name in by_name else average(x) for name, x in values.items()}
    if "std" in found:
        found["std"] = np.sqrt(average(values["std"] ** 2 + (values["mean"] - found["mean"]) ** 2))
    return {"count": [int(counts.sum())], **{name: numbers.tolist() for name, numbers in found.items()}}


def keep(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> None:
    """Write a new folder in the layout of version 3.0: episodes get new numbers from 0, in the order of the files."""
    old, meta = CheckedFolder(path), output / "meta"
    info = checked_info(old)
    old.check_whole()
    kept = {m: rows for m, rows in old.data.items() if str(m) in ids}
    with guarded(old.path / "meta" / "episodes"):
        if old.schema is None:
            raise DataError(f"{old.path}: meta/episodes is not that of version 3.0; repair it.")
        if missing := sorted(ids - {*map(str, old.episodes)}):
            raise DataError(f"{old.path}, demonstration {missing[0]}: it is not in meta/episodes; repair the data set.")
        shots = old.shots(ids)
        for shot in (shot for shot in shots if not shot.path.is_file()):
            ways = "download it, leave its episodes out, or write the list with -o ids.json"
            raise DataError(f"{shot.path}: this video is not there; {ways}.")
    copy_folder(old.path / "meta", meta, without=("episodes", "info.json"))
    files = dict.fromkeys(rows.file for rows in kept.values())
    places = {file: divmod(n, info["chunks_size"]) for n, file in enumerate(files)}
    numbers, n_steps = {m: number for number, m in enumerate(kept)}, 0
    for file, place in places.items():
        table = read_table(old.path / file)
        own = {m: rows for m, rows in rows_of_episodes(table).items() if m in kept}
        if all((np.diff(rows) == 1).all() for rows in own.values()):  # slices are no copies
            table = pa.concat_tables([table.slice(rows[0], len(rows)) for rows in own.values()])
        else:
            table = table.take(np.concatenate([*own.values()]))
        new = {"episode_index": np.repeat([numbers[m] for m in own], [*map(len, own.values())])}
        new["index"] = np.arange(n_steps, n_steps + len(table))
        for k, field in ((k, field) for k, field in enumerate(table.schema) if field.name in new):
            table = table.set_column(k, field, pa.array(new[field.name]).cast(field.type))
        pq.write_table(table, target(output, DATA_PATH, place))
        n_steps += len(table)
    with guarded(old.path / "meta" / "episodes"):
        rows, n = write_episodes(old, output, kept, places, shots, info["chunks_size"]), len(kept)
        info |= {"total_episodes": n, "total_frames": n_steps, "data_path": DATA_PATH}
        info |= {"splits": {"train": f"0:{n}"}} | ({"video_path": VIDEO_PATH} if shots else {})
        (meta / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
    with guarded(old.path / checked_folder.STATS):
        if (stats_file := output / checked_folder.STATS).is_file():  # of features that no episode has they stay
            stats = read_json(stats_file)
            for name in stats:
                of_each = [statistics_in(row, name) for row in rows]
                stats[name] = joined_stats(of_each) if all(of_each) else stats[name]
            stats_file.write_text(json.dumps(stats, indent=4), encoding="utf-8")


FORMAT = Format(
    name="LeRobot",
    claims=claims,
    read=table_folder.read,
    keep=keep,
    unkept=unkept,
    find_defects=checked_folder.find_defects,
    annotate=checked_folder.annotate,
    shots=checked_folder.find_shots,
)
