"""Independent work on the machine's cores.

Fits share threads: NumPy releases the interpreter lock in its loops. Work in Python itself, environments above all,
needs processes.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from typing import TypeVar

from rpil.numerics.types import Array, Float

Item = TypeVar("Item")
Result = TypeVar("Result")

THREADING_MIN_SIZE = 400_000
"""Entries of the design matrix from which array loops take most of the time, and threads are worth starting."""


def cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_parallel(
    function: Callable[[Item], Result],
    items: Iterable[Item],
    features: Float[Array, "N D"],
    min_size: int = THREADING_MIN_SIZE,
) -> list[Result]:
    """``[function(item) for item in items]``, in threads if `features` has at least `min_size` entries.

    The results are the same bits either way: nothing is summed across threads.
    """
    items = list(items)
    workers = min(cores(), len(items))
    if workers < 2 or features.size < min_size:
        return [function(item) for item in items]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(function, items))


def in_processes(
    function: Callable[..., Result], jobs: Sequence[tuple[object, ...]], processes: int | None = None
) -> Iterator[Result]:
    """``function(*job)`` for every job, in order, each as soon as it and all jobs before it are done.

    The function must be one of a module, and the arguments such as can be pickled. The work is shared by one process
    for each core, or by `processes`; with 1 this process works alone.
    """
    workers = min(cores() if processes is None else processes, len(jobs))
    if workers < 2:
        yield from (function(*job) for job in jobs)
        return
    # Spawned, because a fork of a process with threads may hang.
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        try:
            yield from (future.result() for future in [pool.submit(function, *job) for job in jobs])
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
