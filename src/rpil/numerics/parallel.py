"""Independent work on the machine's cores.

Fits share threads: NumPy lets go of the interpreter in its loops. What Python itself has to do, environments above
all, needs processes.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from typing import Any, TypeVar

from rpil.numerics.types import Array

Item = TypeVar("Item")
Answer = TypeVar("Answer")

THREADING_MIN_SIZE = 400_000
"""Entries of the design matrix from which array loops, not the interpreter, take the time."""


def cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_parallel(function: Callable[[Item], Answer], items: Iterable[Item], features: Array) -> list[Answer]:
    """``[function(item) for item in items]``, on all cores where a pass over `features` (N, D) is long enough.

    The answers are the same bits either way: nothing is summed across threads.
    """
    items = list(items)
    workers = min(cores(), len(items))
    if workers < 2 or features.size < THREADING_MIN_SIZE:
        return [function(item) for item in items]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(function, items))


def in_processes(
    function: Callable[..., Answer], jobs: Sequence[tuple[Any, ...]], processes: int | None = None
) -> Iterator[Answer]:
    """``function(*job)`` for every job, in their order, each as soon as it and those before it are done.

    Other Python processes share the work, one for each core by default; 1 is none. `function` and what jobs hold must
    be such that another process finds them: functions of a module, not local ones.
    """
    workers = min(cores() if processes is None else processes, len(jobs))
    if workers < 2:
        yield from (function(*job) for job in jobs)
        return
    # Spawned, because a fork of a process with threads may hang.
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        try:
            yield from (answer.result() for answer in [pool.submit(function, *job) for job in jobs])
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
