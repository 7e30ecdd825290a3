"""Protocol of an engine, as a fit by passes asks for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import reduce
from typing import Protocol, TypeVar, runtime_checkable

from rpil.numerics.blocks import Sums, add

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
R = TypeVar("R")


@runtime_checkable
class Shards(Protocol[T_co]):
    """The blocks of all shards, or what was computed from each block, where the engine keeps them."""

    def map(self, function: Callable[[T_co], R]) -> Iterator[R]:
        """The result for each block, in order, in this process."""

    def then(self, function: Callable[[T_co], R]) -> Shards[R]:
        """The result for each block, where the block is."""

    def kept(self, n_steps: int) -> Shards[T_co]:
        """The same blocks, of `n_steps` steps in all, for many passes, none of which computes them again."""
        return self

    def total(self, function: Callable[[T_co], Sums]) -> Sums:
        """The sum of the results for all blocks, always added up in the same order."""
        return reduce(add, self.map(function))


@runtime_checkable
class Engine(Protocol):
    """Keeps the data and runs the passes."""

    @property
    def n_shards(self) -> int:
        """The number of shards into which the data are best divided."""

    def place(self, shards: Sequence[Iterable[T]]) -> Shards[T]:
        """Take the shards; iterating over a shard reads it, block by block."""
