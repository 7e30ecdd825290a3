"""Independent EM runs on the machine's cores: threads suffice, NumPy lets go of the interpreter in its loops."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from rpil.passes import Array

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_WORTH_A_THREAD = 400_000
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
    if workers < 2 or features.size < _WORTH_A_THREAD:
        return [function(item) for item in items]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(function, items))
