"""The engine for a cluster: Dask's workers keep the blocks; functions with their parameters, and sums, travel.

A shard is read by a worker, or sent to one; where the worker dies, Dask has another worker do it again.
"""

from __future__ import annotations

import asyncio
import ctypes
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, reduce
from itertools import cycle
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from rpil.data.errors import DataError, guarded
from rpil.numerics.blocks import Sums, add
from rpil.scale.local import identity
from rpil.scale.protocol import R, Shards, T

if TYPE_CHECKING:
    from distributed import Client, Future

_SHARDS_PER_THREAD = 2
"""More than one, so that the shards of a worker that died can be divided among the others."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_FREE_BYTES = 1 << 25
"""The names that `mallopt` of the GNU C library has for them, and the largest value that it takes for the second."""

_WORKER_TIMEOUT = 60.0
"""Seconds without any worker after which the fit ends."""


class DaskEngine:
    """Run the passes on the workers of a cluster, which keep the data; results equal those in memory, up to rounding.

    Workers need this package and memory for all data together; each gets one BLAS thread. If a worker dies, others read
    its shards again, or get them again from the scheduler, which keeps data in memory. Workers must find the copy of a
    `Dataset` under the same path as this process.

    Parameters
    ----------
    client : distributed.Client
    n_shards : int, optional
        Number of shards; by default two for each thread of a worker.
    """

    def __init__(self, client: Client, n_shards: int | None = None) -> None:
        self.client, self._n_shards = client, n_shards

    @property
    def n_shards(self) -> int:
        with _guarded():
            return self._n_shards or max(1, _SHARDS_PER_THREAD * sum(self.client.nthreads().values()))

    def place(self, shards: Sequence[Iterable[T]]) -> Shards[T]:
        from dask import config

        with _guarded(), config.set({"distributed.admin.large-graph-warning-threshold": "1 PB"}):
            self.client.wait_for_workers(1, _WORKER_TIMEOUT)
            workers = cycle(self.client.nthreads())  # in turn: else Dask may give most shards to one of them
            where = ({"workers": [next(workers)], "allow_other_workers": True} for _ in shards)
            futures = [self.client.submit(_read, k, pure=False, **at) for k, at in zip(shards, where, strict=True)]
        return RemoteBlocks(self.client, futures)


@contextmanager
def _guarded() -> Iterator[None]:
    """Make one sentence of whatever a cluster that fails raises."""
    with guarded(
        "The Dask cluster", "it was lost", "start it again, with more memory if it killed workers, and fit again"
    ):
        try:
            yield
        except asyncio.CancelledError as error:  # which is no `Exception`
            raise CancelledError(*error.args) from error


@dataclass(frozen=True)
class RemoteBlocks(Shards[T]):
    """Blocks that workers keep, a future for those of each shard."""

    client: Client
    futures: Sequence[Future]

    def map(self, function: Callable[[T], R]) -> Iterator[R]:
        """Workers work on all shards at once; the results come in order."""
        for results in self.run(_map, function):
            yield from results

    def total(self, function: Callable[[T], Sums]) -> Sums:
        """Each worker adds up its own shards."""
        return reduce(add, self.run(_total, function))

    def then(self, function: Callable[[T], R]) -> Shards[R]:
        with _guarded():  # the function is sent once, because it may hold numbers for all demonstrations
            there = self.client.submit(identity, function, pure=False)
            futures = [self.client.submit(_map, shard, there, pure=False) for shard in self.futures]
        return RemoteBlocks(self.client, futures)

    def run(self, task: Callable[..., R], function: Callable[[T], object]) -> Iterator[R]:
        """The result of a task for each shard, in order."""
        with _guarded():
            tasks = deque(self.client.map(task, self.futures, function=function, pure=False))
            while tasks:
                yield self._wait_for(tasks.popleft())  # so that workers release it

    def _wait_for(self, future: Future) -> Any:
        while True:
            try:
                return future.result(timeout=_WORKER_TIMEOUT)
            except TimeoutError:
                self.client.wait_for_workers(1, _WORKER_TIMEOUT)


def _read(shard: Iterable[T]) -> list[T]:
    """On a worker: read the blocks of a shard, or take those that were sent."""
    try:
        return list(shard)
    except DataError as error:
        if not isinstance(error.__cause__, OSError):
            raise
        message = f"A worker of the cluster cannot read the data ({str(error).rstrip('.')})"
        raise DataError(f"{message}; put them where all workers find them under the same path.") from error


def _map(shard: list[T], function: Callable[[T], R]) -> list[R]:
    """On a worker: apply a function to each block."""
    _configure_worker()
    return [function(block) for block in shard]


def _total(shard: list[T], function: Callable[[T], Sums]) -> Sums:
    """On a worker: add up the results of a function for each block."""
    return reduce(add, _map(shard, function))


@cache
def _configure_worker() -> None:
    """Give BLAS one thread, as every thread of the worker works on a shard, and keep freed memory in the process.

    Dask returns it to the system after every array, and NumPy's temporary arrays then get it back page by page: passes
    took ten times as long.
    """
    threadpool_limits(1, "blas")
    with suppress(OSError, AttributeError):  # another C library
        for which in (_TRIM_THRESHOLD, _MMAP_THRESHOLD):
            ctypes.CDLL(None).mallopt(which, _FREE_BYTES)
