"""The engine for data in the memory of this process: it works on as many blocks at a time as there are cores."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain

from rpil.scale.disk import StreamedBlocks, identity
from rpil.scale.protocol import R, Shards, T


class KeptBlocks(StreamedBlocks[T]):
    """Blocks in a list. Each is summed by one thread, so that the number of threads changes no bit."""

    def then(self, function: Callable[[T], R]) -> Shards[R]:
        return KeptBlocks([list(self.map(function))], identity)


@dataclass(frozen=True)
class InMemory:
    """Reads every shard once and keeps its blocks."""

    n_shards: int = 1

    def place(self, shards: Sequence[Iterable[T]]) -> Shards[T]:
        return KeptBlocks([list(chain.from_iterable(shards))], identity)
