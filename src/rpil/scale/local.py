"""Engines of this process, which work on as many blocks at a time as there are cores.

`Streamed` reads the blocks again for every pass, the next block while the blocks before it are worked on; `InMemory`
keeps them. Each block is summed by one thread, so that the number of threads changes no bit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain
from typing import Any

from rpil.numerics.parallel import cores
from rpil.scale.protocol import R, Shards, T


def identity(block: T) -> T:
    """The block as it is."""
    return block


@dataclass(frozen=True)
class LocalBlocks(Shards[T]):
    """Blocks that are read for every pass, or that a list keeps, and the functions that are applied to each."""

    shards: Sequence[Iterable[object]]
    is_kept: bool
    prepare: Callable[[Any], T] = identity

    def map(self, function: Callable[[T], R]) -> Iterator[R]:
        """At most one block more than there are cores is in memory."""
        pending: deque[Future[R]] = deque()
        with ThreadPoolExecutor(cores()) as pool:
            for block in chain.from_iterable(self.shards):
                pending.append(pool.submit(lambda one: function(self.prepare(one)), block))
                del block
                if len(pending) > cores():
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()

    def then(self, function: Callable[[T], R]) -> Shards[R]:
        if self.is_kept:
            return LocalBlocks([list(self.map(function))], is_kept=True)
        prepare = self.prepare
        return LocalBlocks(self.shards, False, lambda block: function(prepare(block)))


@dataclass(frozen=True)
class Streamed:
    """Keeps no block."""

    n_shards: int = 1

    def place(self, shards: Sequence[Iterable[T]]) -> Shards[T]:
        return LocalBlocks(shards, is_kept=False)


class InMemory(Streamed):
    """Reads every shard once and keeps its blocks."""

    def place(self, shards: Sequence[Iterable[T]]) -> Shards[T]:
        return LocalBlocks([list(chain.from_iterable(shards))], is_kept=True)
