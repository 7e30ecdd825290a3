"""The engine for a cluster: Dask's workers keep the blocks; functions with their parameters, and sums, travel.

A shard on disk is read by a worker; where the worker dies, Dask has another worker read it. A shard in memory is sent
to a worker; where the worker dies, the engine sends it again.
"""

from __future__ import annotations

import asyncio
import ctypes
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, reduce
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import threadpool_limits

from rpil.data.errors import DataError, MissingExtraError
from rpil.data.guard import guarded
from rpil.numerics.blocks import Sums, add
from rpil.numerics.types import Array
from rpil.scale.local import identity
from rpil.scale.protocol import R, Shards, T

if TYPE_CHECKING:
    from distributed import Client, Future

_SHARDS_PER_THREAD = 2
"""More than one, so that the shards of a worker that died can be divided among the others."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_FREE_BYTES = 1 << 25
"""The names that `mallopt` of the GNU C library has for them, and the largest value that it takes for the second."""

_MAX_TRIES = 5
"""Times that a lost shard is made again."""

_WORKER_TIMEOUT = 60.0
"""Seconds without any worker after which the fit ends."""


class DaskEngine:
    """Passes run by the workers of a cluster, which keep the data; the results are those in memory, up to rounding.

    Workers need this package and memory for all data together; each gets one BLAS thread. The shards of a worker that
    dies are read, or sent, again. Workers must find the files of a `Dataset` under the same path as this process.

    Parameters
    ----------
    client : distributed.Client
    n_shards : int, optional
        Number of shards; by default two for each thread of a worker.

    Raises
    ------
    MissingExtraError
        Where ``distributed`` is not installed.
    """

    def __init__(self, client: Client, n_shards: int | None = None) -> None:
        _distributed()
        self.client, self._n_shards = client, n_shards

    @property
    def n_shards(self) -> int:
        with _Passes().guarded():
            return self._n_shards or max(1, _SHARDS_PER_THREAD * sum(self.client.nthreads().values()))

    def place(self, shards: Sequence[Iterable[T]]) -> Shards[T]:
        with _Passes().guarded():
            self.client.wait_for_workers(1, _WORKER_TIMEOUT)

        def make(k: int) -> Future:
            shard = shards[k]
            if isinstance(shard, list):  # in memory
                return self.client.scatter(WorkerBlocks.of(shard), hash=False)
            return self.client.submit(_read, shard, pure=False)

        return RemoteBlocks(self.client, shards, make)


@dataclass
class _Passes:
    """Counts the passes over the data; where the cluster fails, whatever it raises, names the one that was reached."""

    n: int = 0

    @contextmanager
    def guarded(self) -> Iterator[None]:
        reached = f"in pass {self.n} over the data" if self.n else "before the first pass over the data"
        remedy = "start it again, and fit again"
        with guarded(f"The Dask cluster, {reached}", "it was lost", remedy):
            try:
                yield
            except asyncio.CancelledError as error:  # which is no `Exception`
                raise CancelledError(*error.args) from error


class RemoteBlocks(Shards[T]):
    """Blocks that workers keep: `make` gives the future of those of shard k, made from those of `parent`, if any."""

    def __init__(
        self,
        client: Client,
        shards: Sequence[object],
        make: Callable[[int], Future],
        parent: RemoteBlocks[Any] | None = None,
    ) -> None:
        self.client, self.shards, self._make, self._parent = client, shards, make, parent
        self._passes: _Passes = parent._passes if parent else _Passes()
        with self._passes.guarded():
            self.futures = [make(k) for k in range(len(shards))]

    def map(self, function: Callable[[T], R]) -> Iterator[R]:
        """Workers work on all shards at once; the results come in order."""
        for results in self.run(_map, function):
            yield from results

    def total(self, function: Callable[[T], Sums]) -> Sums:
        """Each worker adds up its own shards."""
        return reduce(add, self.run(_total, function))

    def then(self, function: Callable[[T], R]) -> Shards[R]:
        with self._passes.guarded():  # sent once, because it may hold numbers for all demonstrations
            there = self.client.submit(identity, function, pure=False)

        def make(k: int) -> Future:
            return self.client.submit(_apply, self.futures[k], there, pure=False)

        return RemoteBlocks(self.client, self.shards, make, self)

    def run(self, task: Callable[..., R], function: Callable[[T], object]) -> Iterator[R]:
        """The result of a task for each shard, in order; a shard that is lost is made again."""
        self._passes.n += 1
        killed = _distributed().scheduler.KilledWorker
        with self._passes.guarded():
            tasks = self.client.map(task, self.futures, function=function, pure=False)
            for k in range(len(tasks)):
                for _ in range(_MAX_TRIES):
                    try:
                        result = self._wait_for(tasks[k])
                        break
                    except (CancelledError, killed):
                        self._make_again(k)
                        tasks[k] = self.client.submit(task, self.futures[k], function, pure=False)
                else:
                    raise DataError(
                        f"The cluster lost shard {k} of the data {_MAX_TRIES} times; give its workers more memory."
                    )
                tasks[k] = None  # so that workers release it
                yield result

    def _wait_for(self, future: Future) -> Any:
        while True:
            try:
                return future.result(timeout=_WORKER_TIMEOUT)
            except TimeoutError:
                self.client.wait_for_workers(1, _WORKER_TIMEOUT)

    def _make_again(self, k: int) -> None:
        if self._parent:
            self._parent._make_again(k)
        self.futures[k] = self._make(k)


@dataclass(frozen=True, eq=False)
class WorkerBlocks:
    """The blocks of a shard on a worker, and the bytes that they need besides the arrays of their parents."""

    blocks: list[Any]
    nbytes: int

    @classmethod
    def of(cls, blocks: Iterable[object], parents: Sequence[object] = ()) -> WorkerBlocks:
        """Blocks made from `parents`, with which they share arrays."""
        blocks, shared = list(blocks), _arrays(parents)
        return cls(blocks, sum(array.nbytes for key, array in _arrays(blocks).items() if key not in shared))

    def __sizeof__(self) -> int:
        return self.nbytes  # Dask asks for it to know the cost of moving the blocks


def _read(shard: Iterable[object]) -> WorkerBlocks:
    """On a worker: read the blocks of a shard."""
    try:
        return WorkerBlocks.of(shard)
    except DataError as error:
        if not isinstance(error.__cause__, OSError):
            raise
        message = f"A worker of the cluster cannot read the data ({str(error).rstrip('.')})"
        raise DataError(f"{message}; put them where all workers find them under the same path.") from error


def _apply(shard: WorkerBlocks, function: Callable[[Any], object]) -> WorkerBlocks:
    """On a worker: apply a function to each block and keep the results."""
    return WorkerBlocks.of(_map(shard, function), parents=shard.blocks)


def _map(shard: WorkerBlocks, function: Callable[[Any], R]) -> list[R]:
    """On a worker: apply a function to each block."""
    _configure_worker()
    return [function(block) for block in shard.blocks]


def _total(shard: WorkerBlocks, function: Callable[[Any], Sums]) -> Sums:
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


def _arrays(value: object) -> dict[int, Array]:
    """All arrays within blocks, by identity."""
    if isinstance(value, np.ndarray):
        return {id(value): value}
    if is_dataclass(value):
        value = [getattr(value, f.name) for f in fields(value)]
    members = value if isinstance(value, list | tuple) else ()
    return {key: array for member in members for key, array in _arrays(member).items()}


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise MissingExtraError("DaskEngine", "dask") from error
    return distributed
