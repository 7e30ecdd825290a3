"""Threads give the results of a loop, in order."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from rpil.numerics import parallel
from rpil.numerics.parallel import in_parallel


@pytest.mark.parametrize("min_size", [0, 10**9])
def test_in_parallel_gives_the_results_of_a_loop(monkeypatch, min_size):
    monkeypatch.setattr(parallel, "THREADING_MIN_SIZE", min_size)
    threads = set()

    def square(x: int) -> int:
        threads.add(threading.current_thread().name)
        return x * x

    assert in_parallel(square, range(20), np.ones((3, 2))) == [x * x for x in range(20)]
    main = threading.main_thread().name
    assert (main in threads) == (min_size > 0 or parallel.cores() < 2)
