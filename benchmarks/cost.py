"""The cost of a pass over all data, and predictions for larger data and clusters.

    python benchmarks/cost.py [--json OUT.json] [--docs docs/scale.md]

Costs are processor seconds of this process on one core, the least of several repetitions: they hardly depend on what
else the machine does. `--docs` replaces the tables between the two marks in that file.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from threadpoolctl import threadpool_limits

from provenance import line, provenance
from rpil import RPIL, Dataset, Settings, open_dataset
from rpil.scale.ascent import block_statistics
from rpil.scale.disk import Streamed
from rpil.scale.fit import DesignMap, StepWeights
from rpil.scale.fit import score_block as score

SEED = 0
LENGTH = 200
STEPS = (10**9, 10**11)
WORKERS = (10, 100, 1_000)
DISK = NETWORK = 1e9
"""Bytes a second that a worker reads, and that the coordinator sends and receives: assumed, not measured."""

MARKS = "<!-- cost.py: begin -->", "<!-- cost.py: end -->"


def write(path: Path, n_steps: int, n_observations: int, n_actions: int) -> None:
    """Demonstrations of `LENGTH` steps, a third of them at random, float32."""
    rng = np.random.default_rng(SEED)
    rule = rng.normal(size=(n_observations, n_actions))
    x = rng.normal(size=(n_steps, n_observations)).astype(np.float32)
    episode = np.arange(n_steps) // LENGTH
    action = np.where(episode % 3 == 0, rng.integers(n_actions, size=n_steps), (x @ rule).argmax(axis=1))
    columns = {f"observation.{d}": x[:, d].copy() for d in range(n_observations)}
    table = pa.table({"episode_index": episode, "action": action, **columns})
    pq.write_table(table, path, use_dictionary=["episode_index", "action"], row_group_size=1 << 17)


def seconds(function: Callable[[], Any], repetitions: int) -> float:
    """Processor seconds of a call, the least of several."""
    taken = []
    for _ in range(repetitions):
        start = time.process_time()
        function()
        taken.append(time.process_time() - start)
    return min(taken)


def measure(data: Dataset, path: Path, repetitions: int, settings: Settings | None) -> dict[str, Any]:
    """Costs for each step, of each shard of a pass."""
    stages: list[str] = []
    model = RPIL(engine=Streamed(), progress=stages.append, random_state=SEED, settings=settings).fit(data)
    n, maps = data.n_steps, (model.judge_features_, model.features_)
    prepare, final = (DesignMap(features, model.space_, model.classes_) for features in maps)
    blocks = [block for shard in data.shards() for block in shard]
    ready = [prepare(block) for block in blocks]
    used = settings or Settings()
    scoring = partial(score, judge=model.judge_, settings=used.judge)
    weigh = replace(StepWeights.of(model.audit_, model.judge_, used.judge, used.audit), final=final)
    lessons = [weigh(one) for one in ready]
    one_pass = partial(block_statistics, policy=model.policy_)
    seen, design, weights = ready[0][1].features, lessons[0][0].features, model.policy_.weights.astype(np.float32)
    with threadpool_limits(1, "blas"):

        def each(function: Callable[[Any], Any], blocks: list[Any]) -> float:
            return 1e9 * seconds(lambda: [function(block) and None for block in blocks], repetitions) / n

        return {
            "read_ns": 1e9 * seconds(lambda: [None for shard in data.shards() for _ in shard], repetitions) / n,
            "prepare_ns": each(prepare, blocks),
            "score_ns": each(scoring, ready),
            "weigh_ns": each(weigh, ready),
            "pass_ns": each(one_pass, lessons),
            "product_ns": each(lambda soft_targets: (soft_targets[0].features @ weights).size, lessons),
            "judge_columns": seen.shape[1],
            "n_columns": design.shape[1],
            "product_flops": 2 * 2 * design.shape[1] * len(data.classes),
            "read_bytes": _column_bytes(path, data) / n,
            "kept_bytes": ready[0][0].observations[0].nbytes + 8 + seen[0].nbytes + design[0].nbytes + 16,
            "parameter_bytes": on_the_wire(one_pass),
            "sum_bytes": on_the_wire(one_pass(lessons[0])),
            "verdict_bytes": on_the_wire(scoring(ready[0])) / ready[0][1].n_demonstrations,
            "passes": sum(stage.startswith("pass ") for stage in stages),
        }


def on_the_wire(message: Any) -> int:
    """Bytes that Dask sends for it."""
    from distributed.protocol import serialize_bytelist

    return sum(memoryview(frame).nbytes for frame in serialize_bytelist(message))


def _column_bytes(path: Path, data: Dataset) -> int:
    metadata = pq.read_metadata(path)
    groups = [metadata.row_group(k) for k in range(metadata.num_row_groups)]
    columns = [group.column(c) for group in groups for c in range(metadata.num_columns)]
    return sum(c.total_compressed_size for c in columns if c.path_in_schema in data.store.data_columns)


def dispatch(n_tasks: int = 400) -> float:
    """Seconds that Dask takes for a task that does nothing, in a local cluster of two processes."""
    import distributed

    with (
        distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=":0", silence_logs="CRITICAL") as local,
        distributed.Client(local, set_as_default=False) as client,
    ):
        taken = []
        for _ in range(5):
            start = time.perf_counter()
            client.gather([client.submit(int, k, pure=False) for k in range(n_tasks)])
            taken.append((time.perf_counter() - start) / n_tasks)
    return statistics.median(taken)


def predict(cost: dict[str, Any], n_steps: float, n_workers: int) -> dict[str, float]:
    """Seconds and bytes of a fit on workers with one core each."""
    own = n_steps / n_workers
    n_parts = 2 * n_workers
    sent = n_parts * (cost["parameter_bytes"] + cost["sum_bytes"])
    place = own * max(cost["read_bytes"] / DISK, 1e-9 * cost["read_ns"]) + own * 1e-9 * _once(cost)
    one_pass = own * 1e-9 * cost["pass_ns"] + n_parts * cost["dispatch_s"] + sent / NETWORK
    weights = 16 * n_steps / NETWORK
    return {
        "place_s": place,
        "pass_s": one_pass,
        "sent_bytes": sent,
        "weights_s": weights,
        "fit_s": place + cost["passes"] * one_pass + weights,
        "memory_bytes": own * cost["kept_bytes"],
        "streamed_pass_s": n_steps * 1e-9 * (cost["read_ns"] + _once(cost) - cost["score_ns"] + cost["pass_ns"]) / 2,
    }


def _once(cost: dict[str, Any]) -> float:
    """Nanoseconds for each step of what is done once where a worker keeps it."""
    return float(cost["prepare_ns"] + cost["score_ns"] + cost["weigh_ns"])


def render(found: dict[str, Any]) -> str:
    """The tables of docs/scale.md."""
    cost, shape = found["cost"], found["shape"]
    lines = [
        f"{shape['n_steps']:,} steps x {shape['n_observations']} observations (float32), {shape['n_actions']} actions, "
        f"demonstrations of {LENGTH} steps, {cost['judge_columns']} columns in the judge's design matrix and "
        f"{cost['n_columns']} in that of the final policy, one core:",
        "",
        "| what | for each step |",
        "|---|---|",
        f"| read from Parquet, page checksums verified | {cost['read_bytes']:.0f} bytes, {cost['read_ns']:.0f} ns |",
        f"| design matrix of the judge, once | {cost['prepare_ns']:.0f} ns |",
        f"| scores of the demonstrations, once | {cost['score_ns']:.0f} ns |",
        f"| weights of the steps and the final design matrix, once | {cost['weigh_ns']:.0f} ns |",
        f"| a pass that fits the final policy, in memory | {cost['pass_ns']:.0f} ns |",
        f"| of which the two products with the design matrix, at the least | {cost['product_flops']:,} flops, "
        f"{2 * cost['product_ns']:.0f} ns |",
        f"| kept by a worker | {cost['kept_bytes']:,} bytes |",
        f"| weights and log-ratios, once at the end, sent to the coordinator | {16} bytes |",
        "",
        "| what | bytes |",
        "|---|---|",
        f"| a function with its parameters, for each shard and pass | {cost['parameter_bytes']:,} |",
        f"| sums that come back, for each shard and pass | {cost['sum_bytes']:,} |",
        f"| scores, for each demonstration, once | {cost['verdict_bytes']:.0f} |",
        "",
        f"This fit took {cost['passes']} passes; Dask takes {1e3 * cost['dispatch_s']:.1f} ms for a task.",
        "",
        "| steps | workers of one core | placing, scores | a pass | sent in a pass | weights | whole fit | memory |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in found["predictions"]:
        lines.append(
            f"| 10^{round(np.log10(row['n_steps']))} | {row['n_workers']:,} | {_time(row['place_s'])} | "
            f"{_time(row['pass_s'])} | {row['sent_bytes'] / 1e6:.1f} MB | {_time(row['weights_s'])} | "
            f"{_time(row['fit_s'])} | {row['memory_bytes'] / 2**30:,.1f} GiB |"
        )
    streamed = [
        f"10^{round(np.log10(n))} steps {_time(predict(cost, n, 1)['streamed_pass_s'])}" for n in (10**7, *STEPS)
    ]
    lines += ["", f"From disk on two cores of one machine a pass takes: {', '.join(streamed)}.", ""]
    return "\n".join([*lines, line(found["provenance"])])


def _time(value: float) -> str:
    for unit, size in (("h", 3600.0), ("min", 60.0), ("s", 1.0)):
        if value >= size:
            return f"{value / size:.1f} {unit}"
    return f"{1e3 * value:.0f} ms"


def run(
    n_steps: int,
    n_observations: int,
    n_actions: int,
    repetitions: int,
    with_dask: bool,
    settings: Settings | None = None,
) -> dict[str, Any]:
    """Everything, as plain numbers and text."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.parquet"
        write(path, n_steps, n_observations, n_actions)
        cost = measure(open_dataset(path), path, repetitions, settings)
    cost["dispatch_s"] = dispatch() if with_dask else 1e-3
    predictions = [{"n_steps": n, "n_workers": w, **predict(cost, n, w)} for n in STEPS for w in WORKERS]
    shape = {"n_steps": n_steps, "n_observations": n_observations, "n_actions": n_actions}
    return {"shape": shape, "cost": cost, "predictions": predictions, "provenance": provenance(SEED)}


def splice(text: str, tables: str) -> str:
    """`text` with `tables` between the marks."""
    head, rest = text.split(MARKS[0])
    return f"{head}{MARKS[0]}\n{tables}\n{MARKS[1]}{rest.split(MARKS[1])[1]}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="also write everything measured")
    parser.add_argument("--docs", type=Path, help="a file whose tables to replace")
    parser.add_argument("--steps", type=int, default=600_000)
    options = parser.parse_args()
    found = run(options.steps, 32, 6, repetitions=5, with_dask=True)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1))
    if options.docs:
        options.docs.write_text(splice(options.docs.read_text(), render(found)))
    print(render(found))


if __name__ == "__main__":
    main()
