"""A cluster: Dask's workers keep the data; only functions with their parameters, and sums, travel.

A part is placed once. One that is on disk is read by a worker, and by another one should that worker die: Dask itself
remembers how. One that is in memory is sent, and sent again by the engine should its worker die.
"""

from __future__ import annotations

import ctypes
import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache, partial, reduce
from typing import Any, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from rpil.errors import DataError, MissingExtraError
from rpil.passes import add
from rpil.solvers import Path, Preconditioner

R = TypeVar("R")

TIMEOUT = 10.0
"""Seconds within which a scheduler answers."""

_PARTS_PER_THREAD = 2
"""Few, so that they are coarse, and more than one, so that what a dead worker held can be shared out."""

_SUMS_BYTES = 1 << 24
"""Bytes of sums that may come back from a pass. Those of single pieces are added here in the order in which one process
would, so that no bit differs, but where they are too many: then workers add some up before."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_KEPT_BYTES = 1 << 25
"""What `mallopt` of the GNU C library calls them, and the most that it takes for the second."""

_TRIES = 5
"""How often a part is asked for before a cluster that loses it time and again is given up."""

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
    if not _patient(client, timeout):
        client.close()
        raise DataError(f"{address}: the scheduler has no workers; start some with: dask worker {address}.")
    return client


@dataclass(frozen=True)
class DaskEngine:
    """Passes run by the workers of a cluster, which hold the data; results as in memory, up to rounding.

    Workers need this package, enough memory for all data together, and one BLAS thread each, which they get. What a
    worker that dies has held is read, or sent, again. Of a `Dataset`, workers must find the files where this process
    does.

    Parameters
    ----------
    client : distributed.Client
    n_parts : int, optional
        Into how many parts to cut the data; two for each thread of a worker by default.

    Raises
    ------
    MissingExtraError
        Where ``distributed`` is not installed.
    """

    client: Any
    parts: int | None = None

    def __init__(self, client: Any, n_parts: int | None = None) -> None:
        _distributed()
        object.__setattr__(self, "client", client)
        object.__setattr__(self, "parts", n_parts)

    @property
    def n_parts(self) -> int:
        return self.parts or max(1, _PARTS_PER_THREAD * sum(self.client.nthreads().values()))

    def place(self, parts: Sequence[Iterable[Any]]) -> Placed:
        if not _patient(self.client, _PATIENCE):
            raise _no_workers()
        workers = itertools.cycle(self.client.nthreads())
        return Placed(_Stage(self.client, list(parts), [next(workers) for _ in parts]))


@dataclass(frozen=True, eq=False)
class Kept:
    """What a worker holds of a part: shards, and the bytes that they hold besides those of another such."""

    shards: list[Any]
    nbytes: int

    @classmethod
    def of(cls, shards: Iterable[Any], besides: Sequence[Any] = ()) -> Kept:
        """Shards, of which those `besides` are kept anyway."""
        shards = list(shards)
        known = _arrays(besides)
        return cls(shards, sum(array.nbytes for key, array in _arrays(shards).items() if key not in known))

    def __sizeof__(self) -> int:
        return self.nbytes  # by which Dask knows what it costs to move


@dataclass(eq=False)
class _Stage:
    """Parts as they are placed, or what became of them in a further step; each can be made again.

    Attributes
    ----------
    client : distributed.Client
    parts : list
    workers : list of str
        Address of the worker that is to hold each part, as long as it lives.
    before : _Stage, optional
        What this one is made from, by
    function : callable, optional
    """

    client: Any
    parts: list[Any]
    workers: list[str]
    before: _Stage | None = None
    function: Callable[[Any], Any] | None = None
    futures: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.futures = [self._made(k) for k in range(len(self.parts))]

    def again(self, k: int) -> None:
        """Part `k` is lost: make it again, from the beginning."""
        if self.before:
            self.before.again(k)
        self.futures[k] = self._made(k)

    def submit(self, k: int, task: Callable[..., Any], *arguments: Any) -> Any:
        """A task on part `k`, for the worker that holds it."""
        where = {"workers": [self.workers[k]], "allow_other_workers": True, "pure": False}
        return self.client.submit(task, self.futures[k], *arguments, **where)

    def _made(self, k: int) -> Any:
        part, where = self.parts[k], [self.workers[k]]
        if self.before:
            return self.before.submit(k, _further, _light(_only(self.function, part)))
        if not isinstance(part, list):
            return self.client.submit(_read, part, workers=where, allow_other_workers=True, pure=False)
        here = self.client.nthreads()  # data themselves; where that worker is gone, another one takes them
        return self.client.scatter(Kept.of(part), workers=where if where[0] in here else None, hash=False)


@dataclass(frozen=True, eq=False)
class Placed:
    """Shards that workers hold.

    Attributes
    ----------
    stage : _Stage
    added : bool
        Whether only sums over shards are wanted.
    """

    stage: _Stage
    added: bool = False

    def map(self, function: Callable[[Any], R]) -> Iterator[R]:
        """All parts are worked on, and come back in order."""
        wanted: tuple[Any, ...] = function, None
        if self.added:
            wanted = _light(function), _SUMS_BYTES // len(self.stage.parts)
        tasks = {k: self.stage.submit(k, _results, *wanted) for k in range(len(self.stage.parts))}
        for k in list(tasks):
            for _ in range(_TRIES):
                try:
                    found = _awaited(self.stage.client, tasks[k])
                    break
                except _lost():
                    self.stage.again(k)
                    tasks[k] = self.stage.submit(k, _results, *wanted)
            else:
                raise DataError(f"The cluster lost part {k} of the data {_TRIES} times; give its workers more memory.")
            del tasks[k]
            yield from found

    def then(self, function: Callable[[Any], Any]) -> Placed:
        at = self.stage
        return Placed(_Stage(at.client, at.parts, at.workers, at, function))

    def summed(self) -> Placed:
        return replace(self, added=True)


def _read(part: Iterable[Any]) -> Kept:
    """On a worker: the pieces of a part."""
    try:
        return Kept.of(part)
    except DataError as error:
        if not isinstance(error.__cause__, OSError):
            raise
        said = f"A worker of the cluster cannot read the data ({str(error).rstrip('.')})"
        raise DataError(f"{said}; put them where all workers find them under the same path.") from error


def _further(kept: Kept, function: Callable[[Any], Any]) -> Kept:
    """On a worker: something of each shard, to be kept."""
    _at_work()
    return Kept.of((function(shard) for shard in kept.shards), besides=kept.shards)


def _results(kept: Kept, function: Callable[[Any], Any], n_bytes: int | None) -> list[Any]:
    """On a worker: something of each shard, to be sent; sums of as many as it takes to send `n_bytes`, if given."""
    _at_work()
    found = [function(shard) for shard in kept.shards]
    if n_bytes is None:
        return found
    one = sum(array.nbytes for array in _arrays(found[0]).values())
    together = -(-len(found) // max(1, n_bytes // max(1, one)))
    return [reduce(add, found[k : k + together]) for k in range(0, len(found), together)]


@cache
def _at_work() -> None:
    """A worker's threads are busy with a part each, so BLAS gets one; and memory that is free stays theirs.

    Dask has it handed back to the system after every array, from where NumPy's temporaries come back page by page: that
    made passes ten times slower.
    """
    threadpool_limits(1, "blas")
    with suppress(OSError, AttributeError):  # another C library has other ways
        for which in (_TRIM_THRESHOLD, _MMAP_THRESHOLD):
            ctypes.CDLL(None).mallopt(which, _KEPT_BYTES)


def _awaited(client: Any, future: Any) -> Any:
    while True:
        try:
            return future.result(timeout=_PATIENCE)
        except TimeoutError:
            if not _patient(client, _PATIENCE):
                raise _no_workers() from None


def _patient(client: Any, seconds: float) -> bool:
    """Whether there is a worker, now or within so many seconds."""
    end = time.monotonic() + seconds
    while not client.nthreads():
        if time.monotonic() > end:
            return False
        time.sleep(0.1)
    return True


def _no_workers() -> DataError:
    return DataError("The cluster has no workers left; start some, and fit again.")


def _only(function: Any, part: Any) -> Any:
    """`function` with what it needs to know of the demonstrations of `part`, and of no others."""
    if not hasattr(function, "only"):
        return function
    those = part.demonstrations if not isinstance(part, list) else _between(part[0], part[-1])
    return function.only(those)


def _between(first: Any, last: Any) -> slice:
    return slice(first.demonstrations.start, last.demonstrations.stop)


def _light(value: Any) -> Any:
    """`value` without what parameters improve with, Hessians and the path so far: that is done here, and sums need
    none of it."""
    if isinstance(value, Preconditioner | Path):
        return None
    if isinstance(value, partial):
        return partial(value.func, *map(_light, value.args), **{k: _light(v) for k, v in value.keywords.items()})
    if type(value) is tuple:
        light = tuple(map(_light, value))
        return light if any(a is not b for a, b in zip(light, value, strict=True)) else value
    if is_dataclass(value) and not isinstance(value, type):
        now = {f.name: getattr(value, f.name) for f in fields(value) if f.init}
        new = {name: _light(one) for name, one in now.items()}
        changed = {name: one for name, one in new.items() if one is not now[name]}
        return replace(value, **changed) if changed else value
    return value


def _arrays(value: Any) -> dict[int, np.ndarray[Any, Any]]:
    """All arrays within shards, by identity."""
    if isinstance(value, np.ndarray):
        return {id(value): value}
    if isinstance(value, list | tuple):
        parts: Iterable[Any] = value
    elif is_dataclass(value) and not isinstance(value, type):
        parts = (getattr(value, f.name) for f in fields(value))
    else:
        return {}
    return {key: array for part in parts for key, array in _arrays(part).items()}


def _lost() -> tuple[type[BaseException], ...]:
    """What a future raises whose data are gone with a worker."""
    distributed = _distributed()
    return CancelledError, distributed.client.FutureCancelledError, distributed.scheduler.KilledWorker


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise MissingExtraError("DaskEngine", "dask") from error
    return distributed
