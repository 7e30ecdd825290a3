"""Fifty made-up episodes of a robot with two arms, as LeRobot 3.0 writes them into the folder reach.

python make_episodes.py        # needs: pip install 'rpil[video]'
python make_episodes.py 0.2    # in the second session the zero of the joint right.y is moved by 0.2

The right hand moves to an object and closes its gripper; the left arm is parked, in each session elsewhere. There are
three sessions, each a file. In fifteen episodes the operator is distracted for two seconds.
"""

from __future__ import annotations

import json
import sys
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

FPS, SIZE, N_MOVING = 20, 64, 80
ROOT, CAMERA = Path("reach"), "observation.images.front"
SESSIONS = {0: range(20), 1: range(20, 34), 2: range(34, 50)}
BAD = (2, 3, 9, 11, 15, 18, 21, 22, 27, 30, 35, 38, 44, 45, 49)
JOINTS = ["right.x", "right.y", "right.gripper", "left.x", "left.y", "left.gripper"]
NUMBERS = ("observation.state", "observation.object", "action")


def episode(m: int, session: int, zero: float) -> dict[str, np.ndarray]:
    """The rows of an episode: idle at first, then a reach, then idle again."""
    rng = np.random.default_rng(m)
    state = np.array([*rng.uniform(0.1, 0.9, size=2), 1.0, 0.3 + 0.1 * session, 0.6, 0.0])
    target, idle = rng.uniform(0.1, 0.9, size=2), rng.integers(5, 40, size=2)
    lost = rng.integers(5, 25) + np.arange(40) if m in BAD else ()
    elsewhere = rng.uniform(0, 0.2, size=2)
    shift = np.array([0, zero if session == 1 else 0, 0, 0, 0, 0])
    rows: dict[str, list[np.ndarray]] = {name: [] for name in NUMBERS}
    for step in range(idle[0] + N_MOVING + idle[1]):
        action = state.copy()
        if step - idle[0] in lost:
            action += [*(0.05 * (elsewhere - state[:2]) + 0.04 * rng.normal(size=2)), 0.02 * rng.normal(), 0, 0, 0]
        elif idle[0] <= step < idle[0] + N_MOVING:
            action[:2] += 0.08 * (target - state[:2]) + 0.01 * rng.normal(size=2)
            action[2] -= 0.05 * state[2] + 0.005 * rng.normal()
        for name, value in zip(NUMBERS, (state, target, action + shift), strict=True):
            rows[name].append(value)
        state = state + 0.8 * (action - state)  # the arm lags behind its command
    return {name: np.array(values) for name, values in rows.items()}


def picture(state: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The object in green, the right hand in red, the left in blue."""
    image = np.full((SIZE, SIZE, 3), 40, dtype=np.uint8)
    for (x, y), colour in ((target, (80, 220, 80)), (state[:2], (230, 70, 70)), (state[3:5], (90, 120, 240))):
        row, column = (int(np.clip(v, 0, 0.99) * (SIZE - 6)) for v in (y, x))
        image[row : row + 6, column : column + 6] = colour
    return image


def write_video(path: Path, images: list[np.ndarray]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=FPS, options={"g": "2", "crf": "30"})
        stream.height = stream.width = SIZE
        stream.pix_fmt, stream.codec_context.time_base = "yuv420p", Fraction(1, FPS)
        for image in images:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(image)))
        file.mux(stream.encode())


def statistics(values: np.ndarray) -> dict[str, list[float]]:
    values = values.astype(float)
    found = {name: getattr(values, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
    return found | {"count": [len(values)]}


def main(zero: float = 0.0) -> None:
    about, everything, first = [], [], 0
    for session, members in SESSIONS.items():
        made = {m: episode(m, session, zero) for m in members}
        images = [
            picture(*both) for one in made.values() for both in zip(one[NUMBERS[0]], one[NUMBERS[1]], strict=True)
        ]
        write_video(ROOT / f"videos/{CAMERA}/chunk-000/file-{session:03d}.mp4", images)
        tables, start = [], first
        for m, one in made.items():
            n = len(one["action"])
            whole = {name: values.astype(np.float32) for name, values in one.items()}
            whole |= {"timestamp": (np.arange(n) / FPS).astype(np.float32), "frame_index": np.arange(n)}
            whole |= {
                "episode_index": np.full(n, m),
                "index": first + np.arange(n),
                "task_index": np.zeros(n, dtype=int),
            }
            everything.append(whole)
            tables.append(
                pa.table({name: values.tolist() if values.ndim > 1 else values for name, values in whole.items()})
            )
            place = {"data/chunk_index": 0, "data/file_index": session, "meta/episodes/chunk_index": 0}
            place |= {"dataset_from_index": first, "dataset_to_index": first + n}
            place |= {f"videos/{CAMERA}/chunk_index": 0, f"videos/{CAMERA}/file_index": session}
            place |= {f"videos/{CAMERA}/from_timestamp": (first - start) / FPS}
            place |= {f"videos/{CAMERA}/to_timestamp": (first - start + n) / FPS}
            about.append({"episode_index": m, "tasks": ["reach"], "length": n, **place})
            first += n
        data = ROOT / f"data/chunk-000/file-{session:03d}.parquet"
        data.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.concat_tables(tables), data)
    write_meta(about, {name: np.concatenate([one[name] for one in everything]) for name in everything[0]})


def write_meta(about: list[dict[str, object]], columns: dict[str, np.ndarray]) -> None:
    meta = ROOT / "meta"
    (meta / "episodes/chunk-000").mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.Table.from_pylist(about), meta / "episodes/chunk-000/file-000.parquet")
    pq.write_table(pa.table({"task_index": [0], "task": ["reach"]}), meta / "tasks.parquet")
    (meta / "stats.json").write_text(json.dumps({name: statistics(values) for name, values in columns.items()}))
    features: dict[str, dict[str, object]] = {
        name: {"dtype": "float32", "shape": [len(JOINTS)], "names": JOINTS} for name in ("observation.state", "action")
    }
    features["observation.object"] = {"dtype": "float32", "shape": [2], "names": ["x", "y"]}
    features[CAMERA] = {"dtype": "video", "shape": [SIZE, SIZE, 3]}
    info = {"codebase_version": "v3.0", "fps": FPS, "total_episodes": len(about), "total_frames": len(columns["index"])}
    info |= {"features": features, "splits": {"train": f"0:{len(about)}"}, "chunks_size": 1000}
    info |= {"data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"}
    info |= {"video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"}
    (meta / "info.json").write_text(json.dumps(info))


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
