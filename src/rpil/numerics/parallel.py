"""Independent work on the machine's cores, in threads: NumPy releases the interpreter lock in its loops."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
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
    function: Callable[[Item], Result], items: Iterable[Item], features: Float[Array, "N D"]
) -> list[Result]:
    """``[function(item) for item in items]``, in threads if `features` has at least `THREADING_MIN_SIZE` entries.

    The results are the same bits either way: nothing is summed across threads.
    """
    items = list(items)
    workers = min(cores(), len(items))
    if workers < 2 or features.size < THREADING_MIN_SIZE:
        return [function(item) for item in items]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(function, items))
