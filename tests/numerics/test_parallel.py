"""Threads give the results of a loop, in order."""

from __future__ import annotations

import os
import threading

import numpy as np
import pytest

from rpil.numerics import parallel
from rpil.numerics.parallel import in_parallel


@pytest.mark.parametrize("min_size", [6, 7])
def test_in_parallel_gives_the_results_of_a_loop(monkeypatch, min_size):
    monkeypatch.setattr(parallel, "THREADING_MIN_SIZE", min_size)
    monkeypatch.setattr(parallel, "cores", lambda: 2)
    threads = set()

    def square(x: int) -> int:
        threads.add(threading.current_thread().name)
        return x * x

    assert in_parallel(square, range(20), np.ones((3, 2))) == [x * x for x in range(20)]
    assert len(threads) <= 2
    assert (threading.main_thread().name in threads) == (min_size > 6)


def test_cores_are_those_of_the_process_or_else_of_the_machine(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 3, 5}, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert parallel.cores() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    assert parallel.cores() == 7
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert parallel.cores() == 1
