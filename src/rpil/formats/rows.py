"""Rows of a recording, read table by table: of a table in memory; `rpil.formats.store` has those of Parquet files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from rpil.formats.table import Place
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

BATCH_ROWS = 65_536
"""Rows of one table, at most."""


class Rows(Protocol):
    """The rows of a recording, those of each demonstration together."""

    @property
    def runs(self) -> list[tuple[int, int]]:
        """First rows, and the rows after the last, of what is read together, as a row group is; in order."""

    def between(self, first: int, last: int) -> Rows:
        """The same without what is not needed to read the rows ``first:last``; these keep their numbers."""

    def tables(
        self, first: int, last: int, columns: list[str], demonstration: Place = lambda _: ""
    ) -> Iterator[tuple[int, pa.Table, Place]]:
        """Rows ``first:last`` in tables: the first row of each, the table, and the place of a row of it for messages.

        `demonstration` names the demonstration of a row of the recording.
        """

    def numbers(self, steps: slice) -> pa.Table | None:
        """The rows of the file, counted from 1, of some steps, where rows were moved."""

    def file_of(self, row: int) -> str:
        """Name of the file that holds a row, for messages."""

    def files(self, rows: Array) -> list[str]:
        """The file of each of some rows, no two alike; none where files say nothing of demonstrations."""


@dataclass(frozen=True, eq=False)
class TableRows:
    """The rows of a table in memory.

    Attributes
    ----------
    table : pyarrow.Table
    source : str
        Its name in messages.
    place : (N,) array, optional
        The row of the table that comes at each place; None where all stay where they are.
    sizes : mapping of str to int
        The numbers of rows from each file; empty for formats in which files say nothing of demonstrations.
    """

    table: pa.Table
    source: str
    place: Array | None = None
    sizes: Mapping[str, int] = field(default_factory=dict)

    @property
    def runs(self) -> list[tuple[int, int]]:
        return [(0, len(self.table))]

    def between(self, first: int, last: int) -> TableRows:
        return self

    def tables(
        self, first: int, last: int, columns: list[str], demonstration: Place = lambda _: ""
    ) -> Iterator[tuple[int, pa.Table, Place]]:
        table = self.table.select(columns)
        for row in range(first, last, BATCH_ROWS):
            size = min(BATCH_ROWS, last - row)
            here = table.slice(row, size) if self.place is None else table.take(self.place[row : row + size])
            yield row, here, self._at(row, demonstration)

    def _at(self, first: int, demonstration: Place) -> Place:
        return lambda row: f"{self.source}{demonstration(first + row)}, row {self._row(first + row) + 1}"

    def _row(self, row: int) -> int:
        return row if self.place is None else int(self.place[row])

    def numbers(self, steps: slice) -> pa.Table | None:
        import pyarrow as pa

        return None if self.place is None else pa.table({"row": self.place[steps] + 1})

    def file_of(self, row: int) -> str:
        return self.source

    def files(self, rows: Array) -> list[str]:
        names, ends = list(self.sizes), np.cumsum(list(self.sizes.values()))
        there = rows if self.place is None else self.place[rows]
        return [names[k] for k in np.searchsorted(ends, there, side="right").tolist()] if names else []


def shifted(at: Place, rows: int) -> Place:
    """`at` for a table without its first `rows`."""
    return lambda row: at(rows + row)
