"""Rows E, G and J: data on disk, a cluster of processes, and starting up."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import rpil
from rpil import Settings
from rpil.estimators.rpil import RPIL
from rpil.scale.dask import DaskEngine
from rpil.scale.local import LocalBlocks, LocalEngine, identity
from rpil.scale.protocol import Engine
from speed_common import Measured, Skipped, in_turns, peak_gib, softmax_expert

PROCESSES = 2
_SHARD_STEPS = 1_000_000
_COLUMN = "observation.{}"


def from_disk(size: dict[str, int], repeats: int) -> Measured:
    """E: peak memory of a process that fits a Parquet file, and the time of its passes, a step, over those in memory.

    Both have all cores. Passes are what grows with the data, so that nothing is gained by what is read once.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = write_shards(Path(folder) / "data.parquet", size["steps"], size["features"], size["actions"])
        small = write_shards(Path(folder) / "small.parquet", size["subset"], size["features"], size["actions"])
        found, beside = [], []
        for _ in range(repeats):
            found.append(_child(from_file, str(path)))
            beside.append(_child(in_memory, str(small)))
        gib = path.stat().st_size / 2**30
    streamed, held = (median(one["pass"] for one in of) for of in (found, beside))
    ratio = (streamed / size["steps"]) / (held / size["subset"])
    values = {"E": ratio, "E_time": ratio, "E_rss_gib": max(one["gib"] for one in found)}
    return Measured(values, {"streamed": found, "memory": beside, "file_gib": gib})


def from_file(path: str) -> dict[str, float]:
    """Fit a file as it lies on disk."""
    return _timed(rpil.open(path, on_disk=True).demonstrations, LocalEngine())


class ListedBlocks(LocalBlocks):
    """Blocks that are kept in memory."""

    def then(self, function: Callable[[Any], Any]) -> ListedBlocks:
        return ListedBlocks(self.shards, super().then(function).prepare)

    def kept(self, n_steps: int) -> ListedBlocks:
        return ListedBlocks([list(self.map(identity))])


class InMemory(LocalEngine):
    """Keeps in memory what is computed from the blocks."""

    def place(self, shards: Any) -> ListedBlocks:
        return ListedBlocks(shards)


def in_memory(path: str) -> dict[str, float]:
    """Read a file, and fit it."""
    return _timed(rpil.read(path), InMemory())


def _timed(data: Any, engine: Engine) -> dict[str, float]:
    """How long a fit and each of its passes took, and the most memory that this process ever had."""
    begun, said = time.perf_counter(), []
    _given(engine=engine, progress=lambda stage: said.append((time.perf_counter(), stage))).fit(data)
    end = time.perf_counter()
    passes = [now for now, stage in said if stage.startswith("pass ")] or [begun]
    return {"seconds": end - begun, "pass": (end - passes[0]) / len(passes), "gib": peak_gib()}


def cluster(size: dict[str, int], repeats: int) -> Measured | Skipped:
    """G: Dask with two worker processes over the same fit in memory, which has as many threads."""
    if find_spec("distributed") is None:
        return Skipped("there is no distributed here, which a cluster needs")
    from distributed import Client, LocalCluster

    data = softmax_expert(size["steps"], size["features"], size["actions"]).demonstrations
    with tempfile.TemporaryDirectory() as folder:
        path = write_shards(Path(folder) / "data.parquet", size["steps"], size["features"], size["actions"])
        with (
            LocalCluster(n_workers=PROCESSES, threads_per_worker=1, dashboard_address=None) as workers,
            Client(workers) as client,
        ):
            seconds, _ = in_turns(
                repeats,
                dask=lambda: _given(engine=DaskEngine(client)).fit(rpil.open(path, on_disk=True).demonstrations),
                memory=lambda: _given().fit(data),
            )
    return Measured({"G": seconds["dask"] / seconds["memory"]}, {"seconds": seconds, "processes": PROCESSES})


def _given(**parameters: Any) -> RPIL:
    return RPIL(features="raw", settings=Settings(judge_features="raw"), **parameters)


def write_shards(path: Path, n_steps: int, n_features: int, n_actions: int) -> Path:
    """`softmax_expert` as Parquet, a shard at a time, so that nothing of the size of the file is in memory."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    writer, done = None, 0
    while done < n_steps:
        data = softmax_expert(min(_SHARD_STEPS, n_steps - done), n_features, n_actions, shard=done).demonstrations
        columns = {_COLUMN.format(k): data.observations[:, k] for k in range(n_features)}
        episode = data.groups + done // 200
        table = pa.table({"episode_index": episode, "action": data.actions, **columns})
        writer = writer or pq.ParquetWriter(path, table.schema, compression="none", use_dictionary=False)
        writer.write_table(table)
        done += len(data.actions)
    if writer is not None:
        writer.close()
    return path


def _child(function: Callable[[str], dict[str, float]], argument: str) -> dict[str, float]:
    """What a function of this module returns in a fresh interpreter."""
    code = f"import json, speed_systems; print(json.dumps(speed_systems.{function.__name__}({argument!r})))"
    found = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=Path(__file__).parent
    )
    return json.loads(found.stdout.splitlines()[-1])


def start_up(size: dict[str, int], repeats: int) -> Measured:
    """J: importing rpil over importing NumPy, and `rpil --help`, each in fresh interpreters."""
    code = {
        "rpil": "import rpil",
        "numpy": "import numpy",
        "help": "import sys; sys.argv = ['rpil', '--help']; from rpil.cli.main import main; main()",
    }
    runs = {name: lambda words=words: _interpret(words) for name, words in code.items()}
    in_turns(1, quiet=True, **runs)  # files come into the cache
    seconds, _ = in_turns(size["starts"], quiet=True, **runs)
    return Measured({"J": seconds["rpil"] / seconds["numpy"], "J_help_s": seconds["help"]}, {"seconds": seconds})


def _interpret(code: str) -> None:
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL, env=dict(os.environ))
