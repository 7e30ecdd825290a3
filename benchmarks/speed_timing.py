"""Fair clocks: runs that take turns, on one core with one thread, and what they say."""

from __future__ import annotations

import os
import resource
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_info, threadpool_limits


@dataclass(frozen=True)
class Measured:
    """What a row found: `values` are ratios, seconds or GiB by key; `details` whatever explains them."""

    values: dict[str, float]
    details: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Skipped:
    """A row that could not be measured, and why."""

    why: str


def in_turns(
    repeats: int, *, quiet: bool = False, **runs: Callable[[], Any]
) -> tuple[dict[str, float], dict[str, Any]]:
    """Median seconds of each of the `runs`, which take turns so that a busy machine hurts all alike; last answers."""
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    answers = {}
    for _ in range(repeats):
        for name, run in runs.items():
            begun = time.perf_counter()
            answers[name] = run()
            seconds[name].append(time.perf_counter() - begun)
            if not quiet:
                print(f"  {name}: {seconds[name][-1]:.3g} s", file=sys.stderr, flush=True)
    return {name: statistics.median(of) for name, of in seconds.items()}, answers


@contextmanager
def one_core() -> Iterator[None]:
    """One core, and one thread of every pool, for whatever runs inside: equal terms for libraries that use more."""
    with threadpool_limits(1):
        if not hasattr(os, "sched_setaffinity"):
            yield
            return
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {max(before)})
        try:
            yield
        finally:
            os.sched_setaffinity(0, before)


def threads() -> dict[str, int]:
    """Threads of every pool that is loaded, BLAS and OpenMP, within `one_core`."""
    with one_core():
        return {f"{pool['internal_api']} {k}": pool["num_threads"] for k, pool in enumerate(threadpool_info())}


def peak_gib() -> float:
    """The most memory that this process had resident so far; `getrusage` would count that of the parent process."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 2**20
