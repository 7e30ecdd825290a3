"""LeRobot's folders: what is kept as a list of episodes and as commands, or as a folder where there are no videos."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.files import StrPath, new_folder, replacing
from rpil.data.folders import copy_folder
from rpil.data.guard import guarded
from rpil.data.id_values import check_ids
from rpil.data.json_files import LARGEST_METADATA, read_json
from rpil.formats import folder
from rpil.formats import table as flat
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, keep_by_own_ids
from rpil.formats.lerobot import read_info
from rpil.formats.parquet import keep_rows
from rpil.formats.parquet_pages import check_pages, check_table
from rpil.formats.store import find_files, opened
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

read = folder.read

WEIGHTS = (
    "LeRobot finds the weight of a step by its index; its policies smolvla, pi0 and pi05 take weights, ACT and "
    "diffusion do not: give these the list of --keep."
)

MAX_LISTED = 100
"""Episodes of a data set whose lists are printed."""

_DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_STATISTICS: dict[str, Callable[..., Array]] = {"min": np.min, "max": np.max, "mean": np.mean, "std": np.std}


def claims(path: Path) -> bool:
    """Whether `path` is a folder with ``meta/info.json`` and ``data``."""
    return (path / "meta" / "info.json").is_file() and (path / "data").is_dir()


def check_output(path: Path, output: Path) -> dict[str, Any]:
    """What ``meta/info.json`` says; a `DataError` where `keep` cannot write to `output`."""
    place = path / "meta" / "info.json"
    with place.open("rb") as file:
        info = read_info(file.read(LARGEST_METADATA + 1), path.resolve().name)
    with guarded(place):
        images = any(feature.get("dtype") in ("video", "image") for feature in info["features"].values())
        size = info.setdefault("chunks_size", 1000)
        if not isinstance(size, int) or size < 1:
            raise ValueError(f"chunks_size is {size!r}")
    if output.suffix.lower() != ".json" and (images or info.get("codebase_version") != "v3.0"):
        what = "with images" if images else "of this version"
        raise DataError(
            f"{path}: data {what} can be cut by LeRobot only; name a .json file as the output, and run the command "
            "that is printed then."
        )
    return info


def keep(path: Path, output: Path, ids: Sequence[Id]) -> None:
    """Write ``{"episodes": [...]}`` where `output` ends in .json, else a new folder in the layout of version 3.0."""
    info = check_output(path, output)
    check_ids(ids, _ids(path), str(path), "them")
    if output.suffix.lower() == ".json":
        with replacing(output) as temporary:
            temporary.write_text(json.dumps({"episodes": sorted(map(int, ids))}, indent=1) + "\n")
        return
    with new_folder(output) as new:
        copy_folder(path / "meta", new / "meta", without="episodes")
        episodes = _Episodes({str(name) for name in ids})
        episodes.copy(path, new, info["chunks_size"])
        with guarded(path / "meta" / "episodes"):
            _write_episodes(path, new, episodes)
        n_episodes = len(episodes.numbers)
        info |= {"total_episodes": n_episodes, "total_frames": episodes.n_steps, "data_path": _DATA_PATH}
        info |= {"splits": {"train": f"0:{n_episodes}"}}
        (new / "meta" / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
        with guarded(path / "meta" / "stats.json"):
            _write_statistics(new)


def _ids(path: Path) -> set[int]:
    """The numbers of the episodes in the data files."""
    from pyarrow import fs

    found: set[int] = set()
    for file in find_files(path)[1]:
        filesystem = fs.LocalFileSystem()
        with opened(filesystem, file) as stored:
            check_pages(filesystem, file, stored, ["episode_index"])
            for batch in stored.iter_batches(columns=["episode_index"]):
                found.update(batch["episode_index"].unique().to_pylist())
    return found


def commands(path: Path, ids: Sequence[object], kept: Sequence[object], output: StrPath = "") -> list[str]:
    """What to give LeRobot, so that it trains on the episodes `kept` among `ids`, or writes a data set of these.

    Where there are more than `MAX_LISTED` episodes, the shell reads their numbers from the JSON file `output`.
    """
    chosen, name, root = set(map(str, kept)), path.resolve().name, str(path)
    dropped = [name for name in ids if str(name) not in chosen]
    train, drop = (shlex.quote(f"[{', '.join(map(str, names))}]") for names in (kept, dropped))
    if len(ids) > MAX_LISTED and Path(output).suffix.lower() != ".json":
        to_list = shlex.join(["rpil", "keep", root, "-o", "keep.json"])
        return [f"The episodes are too many to be printed; to give their list to LeRobot: {to_list}"]
    if len(ids) > MAX_LISTED:
        if list(map(str, ids)) != list(map(str, range(len(ids)))):
            dropped = []  # the JSON file does not say which there are
        train, drop = _read_from(output, "kept"), _read_from(output, f"sorted({{*range({len(ids)})}} - {{*kept}})")
    lines = [
        f"To train on these, whatever the policy: --dataset.episodes={train}",
        f"The same in newer versions of LeRobot: --dataset.exclude_episodes={drop}",
    ]
    words = ["lerobot-edit-dataset", "--repo_id", name, "--root", root, "--new_repo_id", f"{name}_trusted"]
    words += ["--new_root", f"{root.rstrip('/')}_trusted", "--operation.type", "delete_episodes"]
    delete = f"{shlex.join(words)} --operation.episode_indices {drop}"
    return [*lines, f"To write a new data set without the others, videos too: {delete}"] if dropped else lines[:1]


def _read_from(output: StrPath, numbers: str) -> str:
    """What the shell replaces by a list of `numbers`, a term of Python, in which ``kept`` are those in a JSON file."""
    program = f'import json, sys; kept = json.load(open(sys.argv[1]))["episodes"]; print({numbers})'
    return f'"$({shlex.join(["python", "-c", program, str(output)])})"'


class _Episodes:
    """Copies the data of the episodes `wanted`, with new numbers from 0 in the order of the files."""

    def __init__(self, wanted: set[str]) -> None:
        self.wanted = wanted
        self.numbers: dict[int, int] = {}  # by the old one
        self.files: dict[int, tuple[int, int]] = {}  # chunk and file, by the new number
        self.lengths: Counter[int] = Counter()
        self.n_steps = 0

    def copy(self, path: Path, new: Path, chunks_size: int) -> None:
        """Write the data files that hold any of the episodes."""
        n_files = 0
        for file in map(Path, find_files(path)[1]):
            self.place = divmod(n_files, chunks_size)
            target = new / _DATA_PATH.format(chunk_index=self.place[0], file_index=self.place[1])
            target.parent.mkdir(parents=True, exist_ok=True)
            if keep_rows(file, target, self.wanted, ColumnOptions(id="episode_index"), self.renumbered):
                n_files += 1
            else:
                target.unlink()

    def renumbered(self, table: pa.Table) -> pa.Table:
        """Rows with new numbers of episode and step."""
        old = table["episode_index"].to_pylist()
        numbers = [self.numbers.setdefault(m, len(self.numbers)) for m in old]
        self.lengths.update(numbers)
        for number in numbers:
            self.files.setdefault(number, self.place)
        first, self.n_steps = self.n_steps, self.n_steps + len(numbers)
        table = _with_column(table, "episode_index", numbers)
        return _with_column(table, "index", range(first, self.n_steps)) if "index" in table.column_names else table


def _with_column(table: pa.Table, name: str, values: Sequence[object]) -> pa.Table:
    import pyarrow as pa

    field = table.schema.field(name)
    return table.set_column(table.column_names.index(name), field, pa.array(values, field.type))


def _write_episodes(path: Path, new: Path, episodes: _Episodes) -> None:
    """Write the rows about the kept episodes, with their new numbers, places and positions."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    files = sorted((path / "meta" / "episodes").rglob("*.parquet"))
    for file in files:
        check_table(file)
    table = pa.concat_tables(map(pq.read_table, files), promote_options="permissive")
    row_of = {m: row for row, m in enumerate(table["episode_index"].to_pylist())}
    missing = [m for m in episodes.numbers if m not in row_of]
    if missing:
        raise DataError(f"{path}, demonstration {missing[0]!r}: it is not in meta/episodes; repair the data set.")
    table = table.take([row_of[m] for m in episodes.numbers])
    numbers = list(episodes.numbers.values())
    lengths = [episodes.lengths[m] for m in numbers]
    ends = np.cumsum(lengths)
    shifts = {"episode_index": np.array(numbers) - list(episodes.numbers)}
    shifts["index"] = ends - lengths - table["dataset_from_index"].to_numpy()
    values: dict[str, Sequence[object]] = {
        "episode_index": numbers,
        "length": lengths,
        "dataset_from_index": (ends - lengths).tolist(),
        "dataset_to_index": ends.tolist(),
        "data/chunk_index": [episodes.files[m][0] for m in numbers],
        "data/file_index": [episodes.files[m][1] for m in numbers],
        "meta/episodes/chunk_index": [0] * len(numbers),
        "meta/episodes/file_index": [0] * len(numbers),
    }
    for feature, shift in shifts.items():  # statistics of numbers that have changed
        for name in ("min", "max", "mean", "q01", "q10", "q50", "q90", "q99"):
            column = f"stats/{feature}/{name}"
            if column in table.column_names:
                rows = zip(table[column].to_pylist(), shift.tolist(), strict=True)
                values[column] = [[value + by for value in row] for row, by in rows]
    for name in values.keys() & set(table.column_names):
        table = _with_column(table, name, values[name])
    target = new / _EPISODES
    target.parent.mkdir(parents=True)
    pq.write_table(table, target)


def _write_statistics(new: Path) -> None:
    """Write the statistics of all features that the file of statistics has, by the new data."""
    import pyarrow.parquet as pq

    path = new / "meta" / "stats.json"
    if not path.is_file():
        return
    statistics: dict[str, dict[str, Any]] = read_json(path)
    for name, old in statistics.items():
        values = flat.numbers_or_missing(pq.read_table(new / "data", columns=[name])[name])
        if values is not None:
            statistics[name] = old | _statistics(values, old)
    path.write_text(json.dumps(statistics, indent=4), encoding="utf-8")


def _statistics(values: Array, old: Mapping[str, object]) -> dict[str, list[float]]:
    """The statistics of numbers (N, K) that are among the `old` ones: quantiles are called q01 to q99."""
    found = {name: compute(values, axis=0).tolist() for name, compute in _STATISTICS.items() if name in old}
    quantiles = [name for name in old if name[:1] == "q" and name[1:].isdigit()]
    found |= {name: np.quantile(values, int(name[1:]) / 100, axis=0).tolist() for name in quantiles}
    return found | {"count": [len(values)]}


FORMAT = Format(
    name="LeRobot",
    claims=claims,
    read=read,
    keep=keep_by_own_ids(keep),
    check_output=check_output,
    commands_to_keep=commands,
    notes_on_weights=(WEIGHTS,),
    stays_on_disk=folder.holds_parquet,
)
