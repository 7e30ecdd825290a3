"""What a fit to much data asks of an engine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol, TypeVar, runtime_checkable

from rpil.numerics.blocks import Sums

Result = TypeVar("Result")


@runtime_checkable
class Shards(Protocol):
    """The blocks of all shards of the data, or something computed from each, kept where the engine wants it."""

    def map(self, function: Callable[[Any], Result]) -> Iterator[Result]:
        """The result for each block, brought here, in order."""

    def then(self, function: Callable[[Any], Any]) -> Shards:
        """The result for each block, left where the block is.

        A function that holds something of every demonstration may have a method ``only(those: slice)``: the same for
        the demonstrations of a shard, which is what is sent to where the shard is.
        """

    def total(self, function: Callable[[Any], Sums]) -> Sums:
        """The sum of the results for all blocks, always added up in the same order."""


@runtime_checkable
class Engine(Protocol):
    """Where blocks live; `n_parts` is how many shards the data are best cut into."""

    @property
    def n_parts(self) -> int: ...

    def place(self, shards: Sequence[Iterable[Any]]) -> Shards:
        """The blocks of all shards, in order.

        A shard is a part of the data that one worker can hold: to iterate over it is to read it, block by block.
        """
