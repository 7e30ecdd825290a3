"""Fits on a cluster of two worker processes are the fits in memory, also where one of them is killed."""

from __future__ import annotations

import asyncio
import os
import pickle
import signal
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpil
from problems import make, refused
from rpil import DaskEngine, formats
from rpil.data.demonstrations import Block, Demonstrations
from rpil.data.fit_data import FitData
from rpil.scale import dask as engine
from rpil.scale.fit import block_statistics
from small import SAMPLE, small_rpil

distributed = pytest.importorskip("distributed")

# Where a worker is killed its connections are closed by whoever collects them: distributed's, not ours.
pytestmark = [
    pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def cluster():
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs="CRITICAL"
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


def demonstrations():
    toy = make("noisy", 0, n_good=80, n_bad=40, steps=(20, 60))
    return Demonstrations(toy.observations.astype(np.float32), toy.actions, toy.offsets)


def assert_same(one, other):
    for name in ("log_odds", "expert_proba", "step_weight", "step_log_ratio", "reliability"):
        np.testing.assert_allclose(getattr(one.audit_, name), getattr(other.audit_, name), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(one.policy_.weights, other.policy_.weights, rtol=1e-6, atol=1e-6)
    assert one.audit_.verdicts == other.audit_.verdicts


@dataclass(frozen=True)
class KillOnce:
    """`function`, but the first worker that calls it kills its own process in the middle of the task."""

    function: Callable[[Any], Any]
    marker: Path

    def __call__(self, block: Any) -> Any:
        with suppress(FileExistsError):
            self.marker.touch(exist_ok=False)
            os.kill(os.getpid(), signal.SIGKILL)
        return self.function(block)


def test_killed_worker_changes_no_result(cluster, tmp_path, monkeypatch):
    data = demonstrations()
    labels = {0: "good", 100: "bad"}
    here = small_rpil().fit(data, labels=labels)
    formats.write(tmp_path / "a.parquet", data)
    data = rpil.open(tmp_path / "a.parquet", on_disk=True).demonstrations
    cluster.wait_for_workers(2, timeout=30)
    total, passes = engine.RemoteBlocks.total, []

    def total_with_a_kill(self, function):
        passes.append(function)
        return total(self, KillOnce(function, tmp_path / "killed") if len(passes) == 2 else function)

    monkeypatch.setattr(engine.RemoteBlocks, "total", total_with_a_kill)
    there = small_rpil(engine=DaskEngine(cluster, n_shards=4)).fit(data, labels=labels)
    assert (tmp_path / "killed").exists()
    assert_same(here, there)


def test_only_parameters_and_sums_are_sent(cluster):
    cluster.wait_for_workers(2, timeout=60)  # one was killed before
    data = demonstrations()
    model = small_rpil().fit(data)
    problem = FitData(
        model.features_.design(data.observations), data.actions, data.offsets, model.space_, np.zeros(120, dtype=int)
    )
    weight = model.audit_.step_weight
    policy, hessian = model.policy_.with_preconditioner(problem, weight, model.policy_.ridge, 1.0)
    _, sums = policy.collect_suff_stats(problem.features, problem.actions, weight)
    policy, _ = policy.m_step(sums, np.inf, hessian, np.empty((0, 2, 0, 0)))
    assert len(pickle.dumps(partial(block_statistics, policy=policy))) < 2 * policy.weights.nbytes + 4000
    # Sums over the blocks of a shard are added up where they are.
    shards = data.shards(4, SAMPLE.block_steps)
    placed = DaskEngine(cluster, n_shards=2).place(shards[:2])
    steps = [float(len(p.actions)) for shard in shards[:2] for p in shard]
    assert list(placed.map(_steps)) == [(n,) for n in steps]
    assert placed.total(_steps) == (sum(steps),)
    assert len(list(placed.run(engine._total, _steps))) == 2
    assert DaskEngine(cluster).n_shards == 4  # two for each thread


def _steps(block: Block) -> tuple[float]:
    return (float(len(block.actions)),)


def test_files_that_workers_cannot_read_are_refused(cluster, tmp_path):
    formats.write(tmp_path / "a.parquet", demonstrations())
    data = rpil.open(tmp_path / "a.parquet", on_disk=True).demonstrations
    assert pickle.dumps(data.steps.table)  # which gives the file a name
    data.steps.table.path = "/nowhere/rows.arrow"
    placed = DaskEngine(cluster).place(data.shards(2, SAMPLE.block_steps))
    with refused(r"A worker of the cluster cannot read the data .*/nowhere/rows.arrow.*same path"):
        list(placed.map(_steps))


def test_a_cluster_that_is_closed_in_a_fit_is_told_in_one_sentence(monkeypatch):
    with distributed.LocalCluster(
        n_workers=1, processes=False, dashboard_address=":0", silence_logs="CRITICAL"
    ) as cluster:
        client = distributed.Client(cluster, set_as_default=False)
        run, passes = engine.RemoteBlocks.run, []

        def run_with_an_end(self, *arguments):
            passes.append(arguments)
            if len(passes) == 4:
                cluster.close()
            return run(self, *arguments)

        monkeypatch.setattr(engine.RemoteBlocks, "run", run_with_an_end)
        monkeypatch.setattr(engine, "_WORKER_TIMEOUT", 1.0)
        with refused("The Dask cluster: it was lost.*fit again"):
            small_rpil(engine=DaskEngine(client)).fit(demonstrations())
        assert len(passes) == 4
        with suppress(Exception):
            client.close()


class Odd:
    """A client and a future that fail in the ways of distributed when the scheduler is gone."""

    def __init__(self, error):
        self.error = error

    def wait_for_workers(self, *_):
        """There are some."""

    def nthreads(self):
        return {"worker": 1}

    def map(self, _, futures, **__):
        return list(futures)

    def submit(self, function, *_, **__):
        if function is engine.identity:
            raise self.error
        return self

    def result(self, timeout):
        raise self.error


@pytest.mark.parametrize(
    "error",
    [
        AttributeError("'NoneType' object has no attribute 'identity'"),
        RuntimeError("Client is closed.\nCan't send update-graph message. Really."),
        asyncio.CancelledError("key"),
        OSError("Timed out trying to connect"),
    ],
)
def test_any_error_of_the_cluster_is_one_sentence(error):
    odd = DaskEngine(Odd(error), n_shards=1).place([[np.ones(3)]])
    for call in (odd.total, odd.then):
        with refused(f"The Dask cluster: it was lost .{type(error).__name__}"):
            call(_steps)
    odd.client.nthreads = partial(odd.client.result, 1.0)
    with refused("The Dask cluster: it was lost"):
        DaskEngine(odd.client).n_shards  # noqa: B018


def test_a_cluster_without_workers_is_waited_for_no_longer():
    odd = DaskEngine(Odd(TimeoutError("waited")), n_shards=1).place([[np.ones(3)]])
    odd.client.wait_for_workers = lambda *_: (_ for _ in ()).throw(TimeoutError("no worker came"))
    with refused("The Dask cluster: it was lost .*no worker came"):
        odd.total(_steps)
