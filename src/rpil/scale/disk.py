"""The engine for data on disk: every pass reads them again, the next block while the blocks before it are worked on."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain
from typing import Any

from rpil.numerics.parallel import cores
from rpil.scale.protocol import R, Shards, T


@dataclass(frozen=True)
class StreamedBlocks(Shards[T]):
    """Blocks that are read for every pass, and the functions that are applied to each."""

    shards: Sequence[Iterable[object]]
    prepare: Callable[[Any], T]

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
        prepare = self.prepare
        return StreamedBlocks(self.shards, lambda block: function(prepare(block)))


@dataclass(frozen=True)
class Streamed:
    """Keeps no block."""

    n_shards: int = 1

    def place(self, shards: Sequence[Iterable[T]]) -> Shards[T]:
        return StreamedBlocks(shards, identity)


def identity(block: T) -> T:
    """The block as it is."""
    return block
