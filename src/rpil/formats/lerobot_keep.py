"""A new folder of LeRobot with some of the episodes of another, their videos too, in the layout of its version."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

from rpil.data.errors import DataError
from rpil.data.folders import copy_folder
from rpil.data.guard import guarded
from rpil.data.json_files import Parsed, read_json
from rpil.data.names import quoted
from rpil.formats import lerobot_stats as stats
from rpil.formats.lerobot import cameras
from rpil.formats.lerobot_episodes import EpisodeLines, EpisodeTable
from rpil.formats.lerobot_kept import PATHS, Kept, Trims


def write(path: Path, new: Path, info: dict[str, Parsed], ids: Sequence[object], trims: Trims) -> None:
    """Write the episodes `ids` of the folder `path` to the empty folder `new`; `info` is what ``info.json`` says."""
    copy_folder(path / "meta", new / "meta", without="episodes")
    kept = Kept(path, new, info, {str(name) for name in ids}, trims)
    with guarded(path / "meta" / "episodes"):
        about = EpisodeTable.read(kept) if kept.is_v3 else EpisodeLines.read(kept)
        seen = {camera: about.videos(camera) for camera in cameras(info, "video")}
    gone = [camera for camera, files in seen.items() if not any(file.is_file() for file in files.values())]
    for camera in gone:
        del seen[camera], info["features"][camera]
        message = f"{path}: no video of {camera!r} is there; the new folder does not name this camera."
        warnings.warn(message, stacklevel=1)
    lost = [file for files in seen.values() for file in files.values() if not file.is_file()]
    if lost:
        raise DataError(f"{lost[0]}: this video is not there; download it, or leave its episodes out.")
    about.prepare(seen)
    kept.copy_data()
    with guarded(path / "meta" / "episodes"):
        by_episode = about.write(seen, gone)
        n = len(kept.numbers)
        data, videos = PATHS[info["codebase_version"]]
        info |= {"total_episodes": n, "total_frames": kept.n_steps, "data_path": data, "splits": {"train": f"0:{n}"}}
        info |= {"video_path": videos} if seen else {}
        of_v2 = {"total_videos": n * len(seen), "total_chunks": -(-n // int(info["chunks_size"]))}
        info |= {name: value for name, value in of_v2.items() if name in info}
        (new / "meta" / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
    with guarded(path / "meta" / "stats.json"):
        _write_statistics(kept, by_episode, gone)


def _write_statistics(kept: Kept, by_episode: Sequence[Mapping[str, stats.Statistics]], gone: Sequence[str]) -> None:
    """Write the statistics of all features that the file of statistics has, by the new data, or else by episode."""
    place = kept.new / "meta" / "stats.json"
    if not place.is_file():
        return
    old = {name: one for name, one in read_json(place).items() if name not in gone}
    found = stats.of_data(kept.new / "data", old)
    common = set.intersection(*map(set, by_episode)) if by_episode else set()
    found |= {name: stats.joined([own[name] for own in by_episode]) for name in old if name in common - found.keys()}
    left = [name for name in old if name not in found]
    if left:
        message = f"{kept.path}: the statistics of {quoted(left, 5)} are still those of all episodes, because the "
        warnings.warn(f"{message}recording does not say them by episode.", stacklevel=1)
    place.write_text(json.dumps(old | found, indent=4), encoding="utf-8")
