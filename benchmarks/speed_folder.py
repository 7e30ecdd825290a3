"""Row P: `rpil audit` of a large folder in LeRobot's layout, which is made here."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from speed_timing import Measured

EPISODES_PER_FILE = 100


def audit_of_folder(size: dict[str, int], _: int) -> Measured:
    """P: wall and CPU seconds of `rpil audit FOLDER` in a process of its own, and 1 if it tells the time left."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = lerobot_folder(Path(temporary) / "made", size["episodes"], size["steps"], size["joints"])
        command = [sys.executable, "-c", "from rpil.cli.entry import main; main()", "audit", str(folder)]
        begun, before = time.perf_counter(), _children_seconds()
        run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=temporary)
        seconds, used = time.perf_counter() - begun, _children_seconds() - before
    if run.returncode:
        raise RuntimeError(run.stderr)
    details = {"progress": run.stderr.splitlines(), "output": run.stdout.splitlines()[:3]}
    values = {"P": seconds, "P_cpu": used, "P_time_left": float(" s left" in run.stderr)}
    return Measured(values, details)


def _children_seconds() -> float:
    """Processor seconds of the processes that this one has waited for."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def lerobot_folder(folder: Path, n_episodes: int, n_steps: int, n_joints: int) -> Path:
    """A data set of version 3.0 without videos: joints that follow commands, every fifth episode by noise alone."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    for name in ("data/chunk-000", "meta/episodes/chunk-000"):
        (folder / name).mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(_description(n_episodes, n_steps, n_joints)))
    pq.write_table(pa.table({"task_index": [0], "task": ["reach"]}), folder / "meta" / "tasks.parquet")
    for number, first in enumerate(range(0, n_episodes, EPISODES_PER_FILE)):
        episodes = range(first, min(first + EPISODES_PER_FILE, n_episodes))
        made = [_episode(m, n_steps, n_joints) for m in episodes]
        columns: dict[str, Any] = {
            "observation.state": _lists(np.vstack([states for states, _ in made])),
            "action": _lists(np.vstack([actions for _, actions in made])),
            "episode_index": np.repeat(np.array(episodes), n_steps),
            "frame_index": np.tile(np.arange(n_steps), len(made)),
            "timestamp": np.tile(np.arange(n_steps, dtype=np.float32) / 30, len(made)),
            "index": first * n_steps + np.arange(len(made) * n_steps),
            "task_index": np.zeros(len(made) * n_steps, dtype=np.int64),
        }
        pq.write_table(pa.table(columns), folder / f"data/chunk-000/file-{number:03d}.parquet")
    starts = np.arange(n_episodes) * n_steps
    rows = {"episode_index": np.arange(n_episodes), "length": np.full(n_episodes, n_steps)}
    rows |= {"dataset_from_index": starts, "dataset_to_index": starts + n_steps}
    pq.write_table(pa.table(rows), folder / "meta/episodes/chunk-000/file-000.parquet")
    return folder


def _description(n_episodes: int, n_steps: int, n_joints: int) -> dict[str, Any]:
    names = [f"joint_{j}.pos" for j in range(n_joints)]
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [n_joints], "names": names} for name in ("observation.state", "action")
    }
    features |= {name: {"dtype": "int64", "shape": [1]} for name in ("episode_index", "frame_index", "index")}
    features |= {"timestamp": {"dtype": "float32", "shape": [1]}, "task_index": {"dtype": "int64", "shape": [1]}}
    totals = {"total_episodes": n_episodes, "total_frames": n_episodes * n_steps, "chunks_size": 1000}
    path = {"data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"}
    return {"codebase_version": "v3.0", "fps": 30, "features": features} | totals | path


def _episode(number: int, n_steps: int, n_joints: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """States and commands (T, J): each command goes a tenth of the way to a goal that is the same in all episodes."""
    rng, goal = np.random.default_rng([2, number]), np.random.default_rng(0).normal(size=n_joints)
    bad, state = number % 5 == 0, rng.normal(size=n_joints)
    noise = rng.normal(size=(n_steps, n_joints))
    states, actions = np.empty((2, n_steps, n_joints), np.float32)
    for t in range(n_steps):
        states[t] = state
        actions[t] = state + (0.1 * noise[t] if bad else 0.1 * (goal - state) + 0.02 * noise[t])
        state = 0.9 * actions[t] + 0.1 * state
    return states, actions


def _lists(values: NDArray[np.float32]) -> Any:
    import pyarrow as pa

    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
