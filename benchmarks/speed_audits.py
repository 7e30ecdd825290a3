"""Rows K to T and W: default fits of recorded and of wide data, and commands on folders that are made here."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import LogisticRegression, Ridge
from sklearn.model_selection import GroupKFold
from threadpoolctl import threadpool_limits

import rpil
import speed_shares
from rpil.data.demonstrations import Demonstrations
from rpil.estimators.rpil import RPIL
from rpil.formats.format import Dataset
from rpil.policies.features import FeatureMap, FeatureSettings
from speed_common import Measured, Skipped, wide_regression
from worlds.plain import choose, made, reach

N_FOLDS = 5
EPISODES_PER_FILE = 100


def default_fit(letter: str, path: Path | None, repeats: int) -> Measured | Skipped:
    """CPU seconds of `RPIL().fit`, those of reading included, and how many times those of the cross-fit they are."""
    if path is None or not path.exists():
        return Skipped("give the folder of recorded data with --data" if path is None else f"{path} is not there")
    with threadpool_limits(1, "blas"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data, ours, theirs = opened(path), [], []
        data = data.select(slice(None)) if isinstance(data, Dataset) else data
        for _ in range(repeats):
            taken, model = cpu_seconds(lambda: RPIL().fit(opened(path)))
            ours.append(taken)
            seen = data.observations
            features = FeatureMap.fit("folded", seen, offsets=data.offsets, settings=FeatureSettings())
            design = features.design(seen)[:, :-1]
            theirs.append(cpu_seconds(lambda design=design: cross_fit(design, data))[0])
    seconds = {"ours": statistics.median(ours), "cross_fit": statistics.median(theirs)}
    values = {letter: seconds["ours"], f"{letter}_ratio": seconds["ours"] / seconds["cross_fit"]}
    details = {"cpu_seconds": seconds, "shape": list(design.shape), "finding": model.audit_.finding}
    details["where"] = {"fit": speed_shares.of_run(lambda: RPIL().fit(opened(path)))}
    return Measured(values, details)


def wide_fit(size: dict[str, int], repeats: int) -> Measured:
    """O: CPU seconds of `RPIL().fit` on observations with very many columns."""
    data = wide_regression(size["steps"], size["features"], size["actions"], size["demonstrations"]).demonstrations
    with threadpool_limits(1, "blas"):
        runs = [cpu_seconds(lambda: RPIL().fit(data)) for _ in range(repeats)]
    seconds = [taken for taken, _ in runs]
    return Measured({"O": statistics.median(seconds)}, {"cpu_seconds": seconds, "finding": runs[0][1].audit_.finding})


def opened(path: Path) -> Demonstrations | Dataset:
    """A file, or a folder of many."""
    return rpil.open(path, on_disk=True).demonstrations if path.is_dir() else rpil.read(path)


def cpu_seconds(run: Callable[[], Any]) -> tuple[float, Any]:
    """Processor seconds of all threads of this process, and what the run returns."""
    begun = time.process_time()
    answer = run()
    taken = time.process_time() - begun
    print(f"  {taken:.3g} s of CPU", file=sys.stderr, flush=True)
    return taken, answer


def cross_fit(design: NDArray[Any], data: Demonstrations) -> NDArray[Any]:
    """What five scikit-learn models say of the demonstrations that they were not fitted to."""
    actions = data.actions.reshape(len(data.actions), -1)
    discrete = actions.shape[1] == 1 and actions.dtype.kind in "iub"
    said = np.empty(len(design)) if discrete else np.empty(actions.shape)
    for teach, test in GroupKFold(N_FOLDS).split(design, groups=data.groups):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            if discrete:
                model = LogisticRegression(max_iter=1000).fit(design[teach], actions[teach, 0])
                said[test] = model.predict_log_proba(design[test]).max(axis=1)
            else:
                said[test] = Ridge().fit(design[teach], actions[teach]).predict(design[test]).reshape(len(test), -1)
    return said


# ---- a folder --------------------------------------------------------------------------------------------------------


def audit_of_folder(letters: str, size: dict[str, int], repeats: int) -> Measured:
    """P and S: CPU seconds of `rpil audit FOLDER`, and over what cannot be avoided: to read the columns with pyarrow,
    one pass of differences and a five-fold `Ridge`. R and T: the same of `rpil check`, over reading and the pass."""
    used: dict[str, list[float]] = {name: [] for name in ("audit", "check", "read", "pass", "ridge")}
    with tempfile.TemporaryDirectory() as temporary:
        folder = lerobot_folder(Path(temporary) / "made", size["episodes"], size["steps"], size["joints"])
        for _ in range(repeats):
            for name in ("audit", "check"):
                used[name].append(command_seconds(name, folder)[0])
            for name, seconds in unavoidable(folder).items():
                used[name].append(seconds)
        where = {name: speed_shares.of_command(name, folder, environment()) for name in ("audit", "check")}
    seconds = {name: statistics.median(of) for name, of in used.items()}
    least = seconds["read"] + seconds["pass"]
    audit, check = letters
    values = {f"{audit}_cpu": seconds["audit"], audit: seconds["audit"] / (least + seconds["ridge"])}
    values |= {f"{check}_cpu": seconds["check"], check: seconds["check"] / least}
    return Measured(values, {"seconds": seconds, "where": where})


ALONE = """import resource, subprocess, sys
run = subprocess.run(sys.argv[1:], capture_output=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 2**20)
sys.exit(run.stderr.decode() if run.returncode not in (0, 1) else 0)"""
"""A small process that runs a command: the peak of a process includes the memory of its parent when it begins."""


def command_seconds(name: str, path: Path) -> tuple[float, float]:
    """CPU seconds and GiB of a command on `path`, in a process of its own; there may be faults."""
    words = [sys.executable, "-c", ALONE, sys.executable, "-c", "from rpil.cli.entry import main; main()"]
    run = subprocess.run([*words, name, path], capture_output=True, cwd=path.parent, env=environment(), check=False)
    if run.returncode:
        raise RuntimeError(run.stderr.decode())
    seconds, gib = run.stdout.split()
    return float(seconds), float(gib)


def environment() -> dict[str, str]:
    """That of a user, whose modules are compiled once."""
    return {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}


def unavoidable(folder: Path) -> dict[str, float]:
    """CPU seconds to read the states and actions of a folder, of a pass of differences, and of a cross-fit."""
    import pyarrow.dataset

    def read() -> list[NDArray[Any]]:
        table = pyarrow.dataset.dataset(folder / "data").to_table(["observation.state", "action", "episode_index"])
        lists = (table[name].combine_chunks() for name in ("observation.state", "action"))
        wide = [np.asarray(each.flatten()).reshape(table.num_rows, -1) for each in lists]
        return [*wide, np.asarray(table["episode_index"])]

    with threadpool_limits(1):
        seconds, (states, actions, groups) = cpu_seconds(read)
        passed, _ = cpu_seconds(lambda: [np.abs(np.diff(each, axis=0)).max() for each in (states, actions)])
        folds = GroupKFold(N_FOLDS).split(states, groups=groups)
        fitted, _ = cpu_seconds(lambda: [Ridge().fit(states[teach], actions[teach]) for teach, _ in folds])
    return {"read": seconds, "pass": passed, "ridge": fitted}


def wide_audits(size: dict[str, int], repeats: int) -> Measured:
    """W: CPU seconds of `rpil.audit` where there are many useless columns, beside numbers or four classes, or a hundred
    classes."""
    n, useless, n_classes = size["demonstrations"], size["useless"], size["classes"]
    worlds = {
        "W_numbers": made(reach, n, 0.2, useless),
        "W_classes": made(choose, n, 0.2, useless),
        "W_many": made(choose, n, 0.2, n_classes=n_classes, n_steps=40),
    }
    values = {}
    with threadpool_limits(1, "blas"):
        for name, world in worlds.items():
            runs = [cpu_seconds(lambda world=world: rpil.audit(world.demonstrations))[0] for _ in range(repeats)]
            values[name] = statistics.median(runs)
    return Measured(values)


def start(size: dict[str, int], repeats: int) -> Measured:
    """Q: CPU seconds of `rpil audit` and `rpil info` of a small file, and those of an audit over the import of numpy
    and pyarrow; medians of processes that take turns."""
    rng, n_steps = np.random.default_rng(0), size["demonstrations"] * size["steps"]
    states = rng.normal(size=(n_steps, size["columns"] - size["actions"])).cumsum(axis=0) / 10
    noise = np.where(np.arange(n_steps) // size["steps"] % 4, 0.05, 0.8)[:, None]  # every fourth is careless
    actions = np.tanh(states[:, : size["actions"]]) + noise * rng.normal(size=(n_steps, size["actions"]))
    owner = np.repeat(np.arange(size["demonstrations"]), size["steps"])
    data = Demonstrations.from_groups(states, actions, owner)
    with tempfile.TemporaryDirectory() as temporary:
        files = {suffix: str(Path(temporary) / f"drive.{suffix}") for suffix in ("csv", "npz")}
        for file in files.values():
            rpil.write(file, data)
        commands = {"libraries": ["-c", "import numpy, pyarrow"]}
        commands |= {
            f"{name} {suffix}": ["-m", "rpil", name, files[suffix]] for name in ("audit", "info") for suffix in files
        }
        used: dict[str, list[float]] = {name: [] for name in commands}
        for _ in range(repeats + 1):  # of which the first brings files into the cache
            for name, words in commands.items():
                before = _children_seconds()
                subprocess.run(
                    [sys.executable, *words], capture_output=True, check=True, cwd=temporary, env=environment()
                )
                used[name].append(_children_seconds() - before)
    seconds = {name: float(np.median(of[1:])) for name, of in used.items()}
    audit, info = (max(seconds[f"{name} {suffix}"] for suffix in files) for name in ("audit", "info"))
    return Measured({"Q": audit, "Q_ratio": audit / seconds["libraries"], "Q_info": info}, {"seconds": seconds})


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
