"""LeRobot's folders: what is kept as a list of episodes and as commands, or as a new folder with rows and videos."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import warnings
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rpil.data.arrays import Id, group_rows
from rpil.data.errors import DataError
from rpil.data.files import StrPath, new_folder
from rpil.data.folders import copy_folder
from rpil.data.guard import guarded
from rpil.data.id_values import check_ids
from rpil.data.json_files import Parsed, read_json
from rpil.data.names import quoted
from rpil.formats import table_folder
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, Shot
from rpil.formats.lerobot import checked_folder, video
from rpil.formats.lerobot.checked_folder import EPISODES_STATS, INFO, PATHS, STATS, ByFeature, CheckedFolder
from rpil.formats.lerobot.defects import find_defects, find_shots, in_times, in_videos
from rpil.formats.meta_folder import cameras, chunk_size, fill
from rpil.formats.parquet import keep_rows
from rpil.numerics.types import Array

_EPISODES = "meta/episodes/chunk-000/file-000.parquet"

WEIGHTS = (
    "LeRobot 0.6.1 cannot read weights from a file: give it the list of --keep. In review there, and in no release, is "
    "--sample_weighting.type=static --sample_weighting.weights_path=FILE, which finds weights by the index of the step."
)

MAX_LISTED = 100
"""Episodes of a data set whose lists are printed."""


def claims(path: Path) -> bool:
    """Whether `path` is a folder with ``meta/info.json`` and ``data``."""
    return (path / "meta" / "info.json").is_file() and (path / "data").is_dir()


def check_output(path: Path, output: Path) -> dict[str, Parsed]:
    """Read ``meta/info.json``; a `DataError` or `MissingExtraError` where `keep` cannot write to `output`."""
    info = CheckedFolder(path).info
    version = info.get("codebase_version")
    if version not in PATHS:
        raise DataError(f"{path}: a folder of version {str(version)[:20]!r} cannot be given back; name a .json file.")
    with guarded(path / INFO):
        seen = cameras(info, "video")
        wrong = [name for name in seen if not re.fullmatch(r"\w[\w.-]*", name)]
        info["chunks_size"], fps = chunk_size(info) or 0, float(info["fps"])
        info["fps"] = int(fps) if fps.is_integer() else fps
        if wrong:
            raise ValueError(f"{wrong[0]!r} is no name of a camera")
        if info["chunks_size"] < 1 or not 0 < fps < 1e9:
            raise ValueError("chunks_size is no whole number above 0, or fps none")
    if seen and version == "v3.0" and (path / "videos").is_dir():
        video.load_av()
    return info


@dataclass
class Kept:
    """The new folder: the episodes `wanted`, with new numbers from 0 in the order of the files."""

    old: CheckedFolder
    new: Path
    info: dict[str, Parsed]  # what meta/info.json says
    wanted: set[str]
    numbers: dict[int, int] = field(default_factory=dict)  # the new one by the old one
    places: dict[int, tuple[int, int]] = field(default_factory=dict)  # chunk and file of the data, by the new number
    lengths: Counter[int] = field(default_factory=Counter)
    n_steps: int = 0
    place: tuple[int, int] = (0, 0)  # of the data file that is written

    @property
    def is_v3(self) -> bool:
        return str(self.info["codebase_version"]) == "v3.0"

    def place_of(self, number: int) -> tuple[int, int]:
        """The chunk and the file of the new data file, or video of a camera, of this number."""
        chunk, file = divmod(number, int(self.info["chunks_size"]))
        return (chunk, file) if self.is_v3 else (chunk, number)

    def target(self, of_videos: int, chunk: int, file: int, camera: str = "") -> Path:
        """The place of a new file, in a folder that is there."""
        place = self.new / fill(PATHS[self.info["codebase_version"]][of_videos], chunk, file, camera)
        place.parent.mkdir(parents=True, exist_ok=True)
        return place

    def copy_data(self) -> None:
        """Write the data files that hold any of the episodes."""
        n_files, files = 0, self.old.files(self.wanted)
        for file in files:
            self.place = self.place_of(n_files)
            target = self.target(0, *self.place)
            options = ColumnOptions(id="episode_index")
            if keep_rows(file, target, self.wanted, options, self.renumbered):
                n_files += 1
            else:
                target.unlink()
            if not self.is_v3 and len(self.numbers) != n_files:
                raise DataError(f"{file}: it holds several episodes, or one of another file; repair the data set.")

    def renumbered(self, table: pa.Table) -> pa.Table:
        """Rows with new numbers of episode and step."""
        rows = group_rows(table["episode_index"].to_numpy())[2]
        table = table if rows is None else table.take(rows)
        old = table["episode_index"].to_numpy()
        last, (episodes, offsets, _) = len(self.numbers) - 1, group_rows(old)
        numbers = [self.numbers.setdefault(m, len(self.numbers)) for m in episodes.tolist()]
        if np.any(np.diff([last, *numbers]) < 0):
            raise DataError(f"{self.old.path}: its episodes lie within each other; sort the rows by episode_index.")
        for number, n in zip(numbers, np.diff(offsets).tolist(), strict=True):
            self.lengths[number] += n
            self.places.setdefault(number, self.place)
        first, self.n_steps = self.n_steps, self.n_steps + len(old)
        table = with_column(table, "episode_index", np.repeat(numbers, np.diff(offsets)))
        return with_column(table, "index", np.arange(first, self.n_steps)) if "index" in table.column_names else table

    def write_episodes(self, videos: Mapping[str, Mapping[int, Shot]], gone: Sequence[str]) -> list[ByFeature]:
        """Write what is said of the kept episodes, with their new numbers and places, and their videos.

        `videos` say where each camera saw each episode; `gone` are the cameras that are left out. Returned are the
        statistics of each episode, if there are any.
        """
        rows, statistics = {m: dict(self.old.episodes[m]) for m in self.numbers}, self.old.statistics()
        start, found = 0, []
        for m, new in self.numbers.items():
            n = self.lengths[new]
            rows[m].update(episode_index=new, length=n)
            if self.is_v3:
                rows[m].update(dataset_from_index=start, dataset_to_index=start + n)
                for name, place in {"data": self.places[new], "meta/episodes": (0, 0)}.items():
                    rows[m] |= {f"{name}/chunk_index": place[0], f"{name}/file_index": place[1]}
            if statistics:
                own = {feature: one for feature, one in statistics[m].items() if feature not in gone}
                for feature, number in (("episode_index", new), ("index", start)):  # which are counted again
                    if feature in own:
                        own[feature] = checked_folder.shifted_stats(
                            own[feature], number - np.ravel(own[feature]["min"])[0].item()
                        )
                found.append(own)
            start += n
        for camera, shots in videos.items():
            for m, said in self._copy_videos(camera, [shots[m] for m in self.numbers]).items():
                rows[m] |= said if self.is_v3 else {}
        if self.old.schema is not None:
            of_gone = tuple(f"{what}/{camera}/" for camera in gone for what in ("videos", "stats"))
            left = [field for field in self.old.schema if not field.name.startswith(of_gone)]
            for row, own in zip(rows.values(), found, strict=True):
                row |= {f"stats/{feature}/{name}": value for feature, one in own.items() for name, value in one.items()}
            (self.new / _EPISODES).parent.mkdir(parents=True)
            table = pa.Table.from_pylist([*rows.values()], pa.schema(left, self.old.schema.metadata))
            pq.write_table(table, self.new / _EPISODES)
        else:
            lines = [{"episode_index": new, "stats": own} for new, own in enumerate(found)]
            for name, written in {"meta/episodes.jsonl": [*rows.values()], EPISODES_STATS: lines}.items():
                if written:
                    text = "".join(f"{json.dumps(line)}\n" for line in written)
                    (self.new / name).write_text(text, encoding="utf-8")
        return found

    def _copy_videos(self, camera: str, shots: Sequence[Shot]) -> dict[int, dict[str, Parsed]]:
        """Write the videos of a camera; by the old number of each episode, where in them it lies.

        A file of which all episodes are kept whole is copied; of others, the frames of the kept ones.
        """
        n_episodes = Counter(self.old.video(camera, m) for m in self.old.episodes)
        by_file, said = defaultdict[Path, list[Shot]](list), {}
        for shot in shots:
            by_file[shot.path].append(shot)
        for number, (source, own) in enumerate(by_file.items()):
            chunk, file = self.place_of(number)
            target = self.target(1, chunk, file, camera)
            spans = [(shot.start, shot.end) for shot in own]
            if len(own) == n_episodes[source]:
                shutil.copyfile(source, target)
            else:
                starts = video.cut(source, target, spans, float(self.info["fps"]))
                spans = [(start, start + b - a) for start, (a, b) in zip(starts, spans, strict=True)]
            for shot, (start, end) in zip(own, spans, strict=True):
                where = {"chunk_index": chunk, "file_index": file, "from_timestamp": start, "to_timestamp": end}
                said[shot.episode] = {f"videos/{camera}/{name}": value for name, value in where.items()}
        return said


def with_column(table: pa.Table, name: str, values: Sequence[object] | Array) -> pa.Table:
    """The table with other values of the same type in one of its columns."""
    field = table.schema.field(name)
    return table.set_column(table.column_names.index(name), field, pa.array(values).cast(field.type))


def keep(path: Path, output: Path, ids: Sequence[Id], options: ColumnOptions) -> None:
    """Write a new folder in the layout of its version."""
    info, old, wanted = check_output(path, output), CheckedFolder(path), {*map(str, ids)}
    check_ids(ids, old.data, str(path), "them")
    with new_folder(output) as new:
        _write(Kept(old, new, info, wanted))
        with guarded(path / "meta"):
            written = CheckedFolder(new)
            found = [*in_times(written), *in_videos(written, False)]
    for what in dict.fromkeys(one.what for one in found):
        first, *others = (one for one in found if one.what == what)
        more = f" (and {len(others)} more: rpil check lists them)" if others else ""
        warnings.warn(f"{output}, {what} of {first.place}: {first.sentence}{more}.", stacklevel=1)


def _write(kept: Kept) -> None:
    """Write a new folder."""
    old, info, meta = kept.old, kept.info, kept.new / "meta"
    with guarded(old.path / "meta" / "episodes"):
        if (old.schema is not None) != kept.is_v3:
            raise DataError(
                f"{old.path}: meta/episodes is not that of version {info['codebase_version'][1:]}; repair it."
            )
        missing = sorted(kept.wanted - set(map(str, old.episodes)))
        if missing:
            raise DataError(f"{old.path}, demonstration {missing[0]}: it is not in meta/episodes; repair the data set.")
        seen: dict[str, dict[int, Shot]] = {camera: {} for camera in cameras(info, "video")}
        for shot in old.shots(kept.wanted):
            # Before version 3.0 ``meta`` need not say where in its video an episode lies.
            if old.schema is None or f"videos/{shot.camera}/to_timestamp" in old.schema.names:
                seen[shot.camera][shot.episode] = shot
    copy_folder(old.path / "meta", meta, without=("episodes", "info.json"))
    gone = [camera for camera, own in seen.items() if not any(shot.path.is_file() for shot in own.values())]
    for camera in gone:
        del seen[camera], info["features"][camera]
        message = f"{old.path}: no video of {camera!r} is there; the new folder does not name this camera."
        warnings.warn(message, stacklevel=1)
    lost = [shot.path for own in seen.values() for shot in own.values() if not shot.path.is_file()]
    if lost:
        raise DataError(f"{lost[0]}: this video is not there; download it, or leave its episodes out.")
    kept.copy_data()
    with guarded(old.path / "meta" / "episodes"):
        by_episode = kept.write_episodes(seen, gone)
        n, (data, videos) = len(kept.numbers), PATHS[info["codebase_version"]]
        info |= {"total_episodes": n, "total_frames": kept.lengths.total(), "data_path": data}
        info |= {"splits": {"train": f"0:{n}"}} | ({"video_path": videos} if seen else {})
        of_v2 = {"total_videos": n * len(seen), "total_chunks": -(-n // int(info["chunks_size"]))}
        info |= {name: value for name, value in of_v2.items() if name in info}
        (meta / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
    with guarded(old.path / "meta" / "stats.json"):
        _write_statistics(kept, by_episode, gone)


def _write_statistics(kept: Kept, by_episode: Sequence[ByFeature], gone: Sequence[str]) -> None:
    """Write the statistics of all features that the file of statistics has, by the new data, or else by episode."""
    place = kept.new / STATS
    if not place.is_file():
        return
    old = {name: one for name, one in read_json(place).items() if name not in gone}
    found = checked_folder.stats_of_data(kept.new / "data", old)
    common = set.intersection(*map(set, by_episode)) if by_episode else set()
    found |= {
        name: checked_folder.joined_stats([own[name] for own in by_episode])
        for name in old
        if name in common - found.keys()
    }
    left = [name for name in old if name not in found]
    if left:
        message = f"{kept.old.path}: the statistics of {quoted(left, 5)} are still those of all episodes, because the "
        warnings.warn(f"{message}recording does not say them by episode.", stacklevel=1)
    place.write_text(json.dumps(old | found, indent=4), encoding="utf-8")


def commands(path: Path, ids: Sequence[object], kept: Sequence[object], output: StrPath = "") -> list[str]:
    """Commands that let LeRobot 0.6.1 train on the episodes `kept` among `ids`.

    Where there are more than `MAX_LISTED` episodes, the shell reads their numbers from the JSON file `output`.
    """
    is_list, version = Path(output).suffix.lower() == ".json", ""
    with suppress(DataError):
        version = str(CheckedFolder(path).info.get("codebase_version"))
    if Path(output).name and not is_list:
        words = [f"--dataset.repo_id={Path(output).name}", f"--dataset.root={output}"]
        return [*_conversion(path, version, Path(output)), f"To train on the new folder: {shlex.join(words)}"]
    numbers = shlex.quote(f"[{', '.join(map(str, kept))}]")
    if len(ids) > MAX_LISTED and not is_list:
        to_list = shlex.join(["rpil", "keep", str(path), "-o", "keep.json"])
        return [f"The episodes are too many to be printed; to give their list to LeRobot: {to_list}"]
    if len(ids) > MAX_LISTED:
        program = 'import json, sys; print(json.load(open(sys.argv[1]))["episodes"])'
        numbers = f'"$({shlex.join(["python", "-c", program, str(output)])})"'
    lines = [*_conversion(path, version, path), f"To train on these, whatever the policy: --dataset.episodes={numbers}"]
    if len(kept) < len(ids):
        better = "A folder with statistics of its own, videos too: rpil keep with -o"
        new = f"{str(path).rstrip('/')}_trusted"
        lines.append(f"LeRobot then normalises by the others too, which stay in meta/stats.json. {better} {new}")
    return lines


def _conversion(path: Path, version: str, root: Path) -> list[str]:
    """How the folder `root`, of this version and with the statistics at `path`, becomes one of version 3.0."""
    if not version.startswith("v2"):
        return []
    words = ["python", "-m", "lerobot.scripts.convert_dataset_v21_to_v30", f"--repo-id={root.resolve().name}"]
    command = shlex.join([*words, f"--root={root}", "--push-to-hub=false"])
    needs = []
    if version != "v2.1":
        needs = [f"The converter to version 3.0 reads 2.1 only, and this is {version[1:]}: convert it to 2.1 before."]
    elif not (path / EPISODES_STATS).is_file():
        needs = [f"The converter to version 3.0 needs {EPISODES_STATS}, and that is not there."]
    return [*needs, f"LeRobot 0.6.1 reads version 3.0 only; convert it first: {command}"]


FORMAT = Format(
    name="LeRobot",
    claims=claims,
    read=table_folder.read,
    keep=keep,
    has_own_ids=True,
    check_output=check_output,
    commands_to_keep=commands,
    notes_on_weights=(WEIGHTS,),
    find_defects=find_defects,
    annotate=checked_folder.annotate,
    shots=find_shots,
)
