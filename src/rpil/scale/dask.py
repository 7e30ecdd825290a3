"""A cluster: Dask's workers keep the data; only functions with their parameters, and sums, travel.

A shard is placed once. One that is on disk is read by a worker, and by another one should that worker die: Dask itself
remembers how. One that is in memory is sent, and sent again by the engine should its worker die.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, reduce
from typing import Any, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from rpil.data.errors import DataError, MissingExtraError
from rpil.numerics.blocks import Sums, add

R = TypeVar("R")

TIMEOUT = 10.0
"""Seconds within which a scheduler answers."""

_PARTS_PER_THREAD = 2
"""Few, so that they are coarse, and more than one, so that what a dead worker held can be shared out."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_KEPT_BYTES = 1 << 25
"""What `mallopt` of the GNU C library calls them, and the most that it takes for the second."""

_TRIES = 5
"""How often a shard is asked for before a cluster that loses it time and again is given up."""

_PATIENCE = 60.0
"""Seconds without any worker after which none is expected to come back."""


def connect(address: str, timeout: float | None = None) -> Any:
    """A ``distributed.Client`` of the scheduler at `address`.

    Raises
    ------
    DataError
        Where nothing answers within `timeout` seconds (`TIMEOUT`, if not given), or it has no workers.
    MissingExtraError
    """
    distributed = _distributed()
    timeout = TIMEOUT if timeout is None else timeout
    try:
        client = distributed.Client(address, timeout=timeout, set_as_default=False)
    except (OSError, ValueError) as error:
        raise DataError(f"{address}: no Dask scheduler answers there; check the address.") from error
    try:
        client.wait_for_workers(1, timeout)
    except TimeoutError as error:
        client.close()
        said = f"{address}: the scheduler has no workers; start some with: dask worker {address}."
        raise DataError(said) from error
    return client


class DaskEngine:
    """Passes run by the workers of a cluster, which hold the data; results as in memory, up to rounding.

    Workers need this package, enough memory for all data together, and one BLAS thread each, which they get. What a
    worker that dies has held is read, or sent, again. Of a `Dataset`, workers must find the files where this process
    does.

    Parameters
    ----------
    client : distributed.Client
    n_parts : int, optional
        Into how many shards to cut the data; two for each thread of a worker by default.

    Raises
    ------
    MissingExtraError
        Where ``distributed`` is not installed.
    """

    def __init__(self, client: Any, n_parts: int | None = None) -> None:
        _distributed()
        self.client, self._n_parts = client, n_parts

    @property
    def n_parts(self) -> int:
        return self._n_parts or max(1, _PARTS_PER_THREAD * sum(self.client.nthreads().values()))

    def place(self, shards: Sequence[Iterable[Any]]) -> Placed:
        _wait_for_workers(self.client)

        def made(k: int) -> Any:
            if isinstance(shards[k], list):  # data themselves
                return self.client.scatter(Kept.of(shards[k]), hash=False)
            return self.client.submit(_read, shards[k], pure=False)

        return Placed(self.client, shards, made)


class Placed:
    """Blocks that workers hold.

    Parameters
    ----------
    client : distributed.Client
    shards : sequence
    made : callable
        Gives the future of the blocks of a shard, by its number.
    before : Placed, optional
        The blocks that these are made from.
    """

    def __init__(
        self, client: Any, shards: Sequence[Any], made: Callable[[int], Any], before: Placed | None = None
    ) -> None:
        self.client, self.shards, self._made, self._before = client, shards, made, before
        self.futures = [made(k) for k in range(len(shards))]

    def map(self, function: Callable[[Any], R]) -> Iterator[R]:
        """All shards are worked on, and come back in order."""
        for found in self._each(_results, function):
            yield from found

    def total(self, function: Callable[[Any], Sums]) -> Sums:
        """A shard is added up where it is."""
        return reduce(add, self._each(_sums, function))

    def then(self, function: Callable[[Any], Any]) -> Placed:
        def made(k: int) -> Any:
            return self.client.submit(_further, self.futures[k], _only(function, self.shards[k]), pure=False)

        return Placed(self.client, self.shards, made, self)

    def _each(self, task: Callable[..., R], function: Callable[[Any], Any]) -> Iterator[R]:
        killed = _distributed().scheduler.KilledWorker
        tasks = self.client.map(task, self.futures, function=function, pure=False)
        for k in range(len(tasks)):
            for _ in range(_TRIES):
                try:
                    found = self._result(tasks[k])
                    break
                except (CancelledError, killed):
                    self._make_again(k)
                    tasks[k] = self.client.submit(task, self.futures[k], function, pure=False)
            else:
                raise DataError(f"The cluster lost shard {k} of the data {_TRIES} times; give its workers more memory.")
            tasks[k] = None  # so that workers forget it
            yield found

    def _result(self, future: Any) -> Any:
        while True:
            try:
                return future.result(timeout=_PATIENCE)
            except TimeoutError:
                _wait_for_workers(self.client)

    def _make_again(self, k: int) -> None:
        """Shard `k` is lost: make it again, from the beginning."""
        if self._before:
            self._before._make_again(k)
        self.futures[k] = self._made(k)


@dataclass(frozen=True, eq=False)
class Kept:
    """What a worker holds of a shard: blocks, and the bytes that they hold besides those of another such."""

    blocks: list[Any]
    nbytes: int

    @classmethod
    def of(cls, blocks: Iterable[Any], besides: Sequence[Any] = ()) -> Kept:
        """Blocks, of which those `besides` are kept anyway."""
        blocks = list(blocks)
        known = _arrays(besides)
        return cls(blocks, sum(array.nbytes for key, array in _arrays(blocks).items() if key not in known))

    def __sizeof__(self) -> int:
        return self.nbytes  # by which Dask knows what it costs to move


def _read(shard: Iterable[Any]) -> Kept:
    """On a worker: the blocks of a shard."""
    try:
        return Kept.of(shard)
    except DataError as error:
        if not isinstance(error.__cause__, OSError):
            raise
        said = f"A worker of the cluster cannot read the data ({str(error).rstrip('.')})"
        raise DataError(f"{said}; put them where all workers find them under the same path.") from error


def _further(kept: Kept, function: Callable[[Any], Any]) -> Kept:
    """On a worker: something of each block, to be kept."""
    return Kept.of(_results(kept, function), besides=kept.blocks)


def _results(kept: Kept, function: Callable[[Any], Any]) -> list[Any]:
    """On a worker: something of each block, to be sent."""
    _at_work()
    return [function(block) for block in kept.blocks]


def _sums(kept: Kept, function: Callable[[Any], Sums]) -> Sums:
    return reduce(add, _results(kept, function))


@cache
def _at_work() -> None:
    """A worker's threads are busy with a shard each, so BLAS gets one; and memory that is free stays theirs.

    Dask has it handed back to the system after every array, from where NumPy's temporaries come back page by page: that
    made passes ten times slower.
    """
    threadpool_limits(1, "blas")
    with suppress(OSError, AttributeError):  # another C library has other ways
        for which in (_TRIM_THRESHOLD, _MMAP_THRESHOLD):
            ctypes.CDLL(None).mallopt(which, _KEPT_BYTES)


def _wait_for_workers(client: Any) -> None:
    try:
        client.wait_for_workers(1, _PATIENCE)
    except TimeoutError as error:
        raise DataError("The cluster has no workers left; start some, and fit again.") from error


def _only(function: Any, shard: Any) -> Any:
    """`function` with what it needs to know of the demonstrations of `shard`, and of no others."""
    if not hasattr(function, "only"):
        return function
    ends = shard if isinstance(shard, list) else [shard]
    return function.only(slice(ends[0].demonstrations.start, ends[-1].demonstrations.stop))


def _arrays(value: Any) -> dict[int, np.ndarray[Any, Any]]:
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
