"""What a fit to much data asks of an engine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol, TypeVar, runtime_checkable

from rpil.numerics.blocks import Sums

Result = TypeVar("Result")


@runtime_checkable
class Shards(Protocol):
    """Something of every piece of the data, kept where the engine wants it."""

    def map(self, function: Callable[[Any], Result]) -> Iterator[Result]:
        """The result for each shard, brought here, in order."""

    def then(self, function: Callable[[Any], Any]) -> Shards:
        """The result for each shard, left where the shard is.

        A function that holds something of every demonstration may have a method ``only(those: slice)``: the same for
        the demonstrations of a part, which is what is sent to where the part is.
        """

    def total(self, function: Callable[[Any], Sums]) -> Sums:
        """The sum of the results for all shards, always added up in the same order."""


@runtime_checkable
class Engine(Protocol):
    """Where shards live; `n_parts` is how many parts the data are best cut into."""

    @property
    def n_parts(self) -> int: ...

    def place(self, parts: Sequence[Iterable[Any]]) -> Shards:
        """The pieces of all parts, in order.

        A part is a stretch of the data that one worker can hold: to iterate over it is to read it, piece by piece.
        """
