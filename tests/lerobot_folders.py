"""Folders of LeRobot with videos, as its versions 3.0 and 2.1 write them, and a reader of the same layouts."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

FPS = 20
_MADE: dict[tuple[object, ...], Path] = {}
"""Folders that were made, by what was asked for."""


def statistics(values: Any) -> dict[str, Any]:
    values = np.asarray(values, dtype=float).reshape(len(values), -1)
    plain = {name: getattr(values, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
    return plain | {"count": [len(values)], "q10": np.quantile(values, 0.1, axis=0).tolist()}


def pictures(seed: int, length: int) -> list[np.ndarray[Any, Any]]:
    """Frames of coarse noise, none of which is like another."""
    rng = np.random.default_rng(seed)
    return [
        np.kron(rng.integers(0, 255, (6, 8, 3), dtype=np.uint8), np.ones((8, 8, 1), np.uint8)) for _ in range(length)
    ]


def write_video(path: Path, frames: Sequence[np.ndarray[Any, Any]], codec: str, options: dict[str, str]) -> None:
    import av

    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, rate=FPS, options=options)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt, stream.codec_context.time_base = "yuv420p", Fraction(1, FPS)
        for frame in frames:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(frame))))
        file.mux(stream.encode())


def image_statistics(frames: Sequence[np.ndarray[Any, Any]]) -> dict[str, Any]:
    """As LeRobot has them: one number for each colour."""
    found = statistics(np.concatenate([frame.reshape(-1, 3) for frame in frames]) / 255)
    return {name: np.reshape(value, (-1, 1, 1)).tolist() for name, value in found.items() if name != "count"} | {
        "count": [len(frames)]
    }


def write(
    root: Path,
    lengths: Sequence[int],
    version: str = "v3.0",
    cameras: Sequence[str] = ("front",),
    codec: str = "libx264",
    options: dict[str, str] | None = None,
    per_file: int = 3,
) -> Path:
    """Episodes whose every frame differs; of 3.0 `per_file` share one. A folder is made once, and then copied."""
    asked = tuple(lengths), version, tuple(cameras), codec, repr(options), per_file
    if asked not in _MADE:
        folder = Path(tempfile.mkdtemp())
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        _MADE[asked] = _make(folder / "made", lengths, version, cameras, codec, options, per_file)
    shutil.copytree(_MADE[asked], root, dirs_exist_ok=True)
    return root


def _make(
    root: Path,
    lengths: Sequence[int],
    version: str,
    cameras: Sequence[str],
    codec: str,
    options: dict[str, str] | None,
    per_file: int,
) -> Path:
    options = {"g": "2", "crf": "30"} if options is None else options
    rng, n, rows, whole = np.random.default_rng(0), sum(lengths), [], {}
    episode = np.repeat(np.arange(len(lengths)), lengths)
    frame = np.concatenate([np.arange(length) for length in lengths])
    columns = {"observation.state": rng.normal(size=(n, 2)), "action": rng.normal(size=(n, 2))}
    columns |= {"timestamp": (frame / FPS).astype(np.float32), "frame_index": frame, "episode_index": episode}
    columns |= {"index": np.arange(n), "task_index": 0 * frame}
    table = pa.table({name: values.tolist() if values.ndim > 1 else values for name, values in columns.items()})
    keys = [f"observation.images.{camera}" for camera in cameras]
    shots = {key: [pictures(100 * k + m, n) for m, n in enumerate(lengths)] for k, key in enumerate(keys)}
    is_v3 = version == "v3.0"
    step = per_file if is_v3 else 1
    groups = [range(a, min(a + step, len(lengths))) for a in range(0, len(lengths), step)]
    for number, group in enumerate(groups):
        names = {"chunk": 0, "file": number}
        data = "data/chunk-000/" + ("file-{file:03d}" if is_v3 else "episode_{file:06d}").format(**names)
        (root / data).parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(table.filter(pa.array(np.isin(episode, group))), root / f"{data}.parquet")
        for key in keys:
            place = f"videos/{key}/chunk-000/file-{number:03d}.mp4"
            place = place if is_v3 else f"videos/chunk-000/{key}/episode_{number:06d}.mp4"
            write_video(root / place, [one for m in group for one in shots[key][m]], codec, options)
        for m in group:
            own = {name: statistics(values[episode == m]) for name, values in columns.items()}
            own |= {key: image_statistics(shots[key][m]) for key in keys}
            start = sum(lengths[: group[0]])
            first, length = sum(lengths[:m]), lengths[m]
            about = {"episode_index": m, "tasks": ["lift"], "length": length}
            if is_v3:
                about |= {"data/chunk_index": 0, "data/file_index": number, "dataset_from_index": first}
                about |= {"dataset_to_index": first + length, "meta/episodes/chunk_index": 0}
                for key in keys:
                    about |= {f"videos/{key}/chunk_index": 0, f"videos/{key}/file_index": number}
                    about |= {f"videos/{key}/from_timestamp": (first - start) / FPS}
                    about |= {f"videos/{key}/to_timestamp": (first + length - start) / FPS}
                about |= {f"stats/{name}/{what}": value for name, one in own.items() for what, value in one.items()}
            rows.append((about, own))
    whole = {name: statistics(values) for name, values in columns.items()}
    whole |= {key: image_statistics([one for shot in shots[key] for one in shot]) for key in keys}
    meta = root / "meta"
    (meta / "episodes" / "chunk-000").mkdir(parents=True)
    features = {name: {"dtype": "float64", "shape": [2]} for name in ("observation.state", "action")}
    features |= {key: {"dtype": "video", "shape": [48, 64, 3]} for key in keys}
    info = {"codebase_version": version, "fps": FPS, "total_episodes": len(lengths), "total_frames": n}
    info |= {"features": features, "splits": {"train": f"0:{len(lengths)}"}, "chunks_size": 1000}
    v3 = ("data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",)
    v3 += ("videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",)
    v2 = ("data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",)
    v2 += ("videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",)
    info |= dict(zip(("data_path", "video_path"), v3 if is_v3 else v2, strict=True))
    if is_v3:
        pq.write_table(pa.Table.from_pylist([row for row, _ in rows]), meta / "episodes/chunk-000/file-000.parquet")
        pq.write_table(pa.table({"task_index": [0], "task": ["lift"]}), meta / "tasks.parquet")
        (meta / "stats.json").write_text(json.dumps(whole))
    else:
        (meta / "episodes" / "chunk-000").rmdir()
        (meta / "episodes").rmdir()
        info |= {"total_videos": len(lengths) * len(keys), "total_chunks": 1}
        (meta / "tasks.jsonl").write_text(json.dumps({"task_index": 0, "task": "lift"}) + "\n")
        (meta / "episodes.jsonl").write_text("".join(json.dumps(row) + "\n" for row, _ in rows))
        lines = [{"episode_index": row["episode_index"], "stats": own} for row, own in rows]
        (meta / "episodes_stats.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    (meta / "info.json").write_text(json.dumps(info))
    return root


def videos(root: Path, version: str, camera: str, m: int) -> Path:
    """The video of an episode in a folder that has one in each file."""
    name = f"observation.images.{camera}"
    v3 = root / "videos" / name / f"chunk-000/file-{m:03d}.mp4"
    return v3 if version == "v3.0" else root / "videos" / "chunk-000" / name / f"episode_{m:06d}.mp4"


def change_info(root: Path, **values: Any) -> None:
    """Give ``meta/info.json`` other values."""
    place = root / "meta" / "info.json"
    place.write_text(json.dumps(json.loads(place.read_text()) | values))


@contextmanager
def changing_episodes(root: Path) -> Iterator[list[dict[str, Any]]]:
    """The rows of ``meta/episodes`` of version 3.0, which are written as the block leaves them."""
    place = root / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    rows = pq.read_table(place).to_pylist()
    yield rows
    pq.write_table(pa.Table.from_pylist(rows), place)


@lru_cache(maxsize=4)
def _shown(path: Path, changed: int) -> dict[float, np.ndarray[Any, Any]]:
    """The frames of a video, which was last `changed` then, by their times."""
    import av

    with av.open(str(path)) as file:
        return {float(frame.time): frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)}


def frames_at(path: Path, times: Any) -> list[np.ndarray[Any, Any]]:
    """The frames shown at these times, which must be those of frames, as LeRobot demands."""
    shown = _shown(path, path.stat().st_mtime_ns)
    known = np.array(sorted(shown))
    nearest = [known[np.argmin(np.abs(known - time))] for time in times]
    np.testing.assert_allclose(nearest, times, atol=1e-4)
    return [shown[time] for time in nearest]


def read(root: Path) -> list[dict[str, Any]]:
    """Each episode: its rows, and the frames of each camera at the times of its rows."""
    info = json.loads((root / "meta" / "info.json").read_text())
    keys = [name for name, feature in info["features"].items() if feature["dtype"] == "video"]
    is_v3 = info["codebase_version"] == "v3.0"
    if is_v3:
        rows = pq.read_table(root / "meta" / "episodes").to_pylist()
    else:
        rows = [json.loads(line) for line in (root / "meta" / "episodes.jsonl").read_text().splitlines()]
    assert [row["episode_index"] for row in rows] == [*range(info["total_episodes"])]
    assert sum(row["length"] for row in rows) == info["total_frames"]
    found = []
    for m, row in enumerate(rows):
        names = {"episode_index": m, "episode_chunk": m // info["chunks_size"]}
        names |= {name: row.get(f"data/{name}") for name in ("chunk_index", "file_index")} if is_v3 else {}
        table = pq.read_table(root / info["data_path"].format(**names))
        table = table.filter(pa.compute.equal(table["episode_index"], m))
        assert len(table) == row["length"]
        if is_v3:
            assert table["index"].to_pylist() == [*range(row["dataset_from_index"], row["dataset_to_index"])]
        assert table["frame_index"].to_pylist() == [*range(len(table))]
        own = {"rows": table}
        for key in keys:
            times, about = table["timestamp"].to_numpy().astype(float), names
            if is_v3:
                about = {name: row[f"videos/{key}/{name}"] for name in ("chunk_index", "file_index")}
                times = times + row[f"videos/{key}/from_timestamp"]
                assert row[f"videos/{key}/to_timestamp"] >= times[-1] + 0.5 / FPS
            own[key] = frames_at(root / info["video_path"].format(**about, video_key=key), times)
        found.append(own)
    return found
