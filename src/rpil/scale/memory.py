"""The engine for data in the memory of this process: it works on as many blocks at a time as there are cores."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import reduce
from itertools import chain

from rpil.numerics.blocks import Sums, add
from rpil.numerics.parallel import cores
from rpil.scale.protocol import R, Shards, T


@dataclass(frozen=True)
class LocalBlocks(Shards[T]):
    """Blocks in a list. Each is summed by one thread, so that the number of threads changes no bit."""

    blocks: list[T]

    def map(self, function: Callable[[T], R]) -> Iterator[R]:
        if min(cores(), len(self.blocks)) < 2:
            yield from map(function, self.blocks)
            return
        with ThreadPoolExecutor(cores()) as pool:
            yield from pool.map(function, self.blocks)

    def then(self, function: Callable[[T], R]) -> Shards[R]:
        return LocalBlocks(list(self.map(function)))

    def total(self, function: Callable[[T], Sums]) -> Sums:
        return reduce(add, self.map(function))


@dataclass(frozen=True)
class InMemory:
    """Reads every shard once and keeps its blocks."""

    n_shards: int = 1

    def place(self, shards: Sequence[Iterable[T]]) -> Shards[T]:
        return LocalBlocks(list(chain.from_iterable(shards)))
