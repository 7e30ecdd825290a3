"""The engine of this process: each block is summed by one thread, so that the number of threads changes no bit."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain
from typing import Any, cast

from rpil.numerics.parallel import cores
from rpil.scale.protocol import R, Shards, T
from rpil.scale.step_file import StepFile


def identity(block: T) -> T:
    """The block as it is."""
    return block


@dataclass(frozen=True)
class LocalBlocks(Shards[T]):
    """Blocks that are read, and from which `prepare` computes others, in every pass until these are kept."""

    shards: Sequence[Iterable[object]]
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
        return LocalBlocks(self.shards, lambda block: function(self.prepare(block)))

    def kept(self, n_steps: int) -> Shards[T]:
        """The blocks, which are named tuples of arrays, in a temporary file."""
        file, kind = StepFile(n_steps), cast(Any, None)
        for block in self.map(identity):
            file.append(block)
            kind = type(block)
        return LocalBlocks([file.blocks], lambda steps: kind(*file.read(steps)))


@dataclass(frozen=True)
class LocalEngine:
    """The engine of this process, which works on as many blocks at a time as there are cores."""

    n_shards: int = 1

    def place(self, shards: Sequence[Iterable[T]]) -> Shards[T]:
        return LocalBlocks(shards)
