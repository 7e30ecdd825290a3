"""Everything in this process's memory, on all its cores."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import reduce
from itertools import chain
from typing import Any, TypeVar

from rpil.numerics.blocks import Sums, add
from rpil.numerics.parallel import cores

R = TypeVar("R")


@dataclass(frozen=True)
class Held:
    """Blocks in a list. Several are worked on at a time, which changes no bit: each is summed on its own."""

    blocks: list[Any]

    def map(self, function: Callable[[Any], R]) -> Iterator[R]:
        if min(cores(), len(self.blocks)) < 2:
            yield from map(function, self.blocks)
            return
        with ThreadPoolExecutor(cores()) as pool:
            yield from pool.map(function, self.blocks)

    def then(self, function: Callable[[Any], Any]) -> Held:
        return Held(list(self.map(function)))

    def total(self, function: Callable[[Any], Sums]) -> Sums:
        return reduce(add, self.map(function))


@dataclass(frozen=True)
class InMemory:
    """Reads every shard once, and keeps it."""

    n_parts: int = 1

    def place(self, shards: Sequence[Iterable[Any]]) -> Held:
        return Held(list(chain.from_iterable(shards)))
