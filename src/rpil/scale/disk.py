"""Data that stay on disk: read anew for every pass, the next block while this one computes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import reduce
from itertools import chain
from typing import Any, TypeVar

from rpil.numerics.blocks import Sums, add
from rpil.numerics.parallel import cores

R = TypeVar("R")


def _same(block: Any) -> Any:
    return block


@dataclass(frozen=True)
class Stream:
    """Blocks of shards, and what becomes of each before a pass sees it."""

    shards: Sequence[Iterable[Any]]
    prepare: Callable[[Any], Any]

    def map(self, function: Callable[[Any], R]) -> Iterator[R]:
        """One block is read while as many as there are cores are worked on: so many are in memory, and one more."""
        at_work: deque[Future[R]] = deque()
        with ThreadPoolExecutor(cores()) as pool:
            for block in chain.from_iterable(self.shards):
                at_work.append(pool.submit(lambda one: function(self.prepare(one)), block))
                del block
                if len(at_work) > cores():
                    yield at_work.popleft().result()
            while at_work:
                yield at_work.popleft().result()

    def then(self, function: Callable[[Any], Any]) -> Stream:
        prepare = self.prepare
        return Stream(self.shards, lambda block: function(prepare(block)))

    def total(self, function: Callable[[Any], Sums]) -> Sums:
        return reduce(add, self.map(function))


@dataclass(frozen=True)
class Streamed:
    """Keeps nothing."""

    n_parts: int = 1

    def place(self, shards: Sequence[Iterable[Any]]) -> Stream:
        return Stream(shards, _same)
