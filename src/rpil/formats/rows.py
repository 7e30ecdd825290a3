"""Rows of a recording, read table by table: of a table in memory; `rpil.formats.store` has those of Parquet files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import pyarrow as pa

from rpil.formats.table import Place
from rpil.numerics.types import Array, Int

BATCH_ROWS = 65_536
"""Maximum rows per batch."""


class Rows(Protocol):
    """The rows of a recording, those of each demonstration together."""

    @property
    def sizes(self) -> Mapping[str, int]:
        """The numbers of rows from each file; empty for formats in which files say nothing of demonstrations."""

    @property
    def schema(self) -> pa.Schema:
        """The columns, and their types."""

    @property
    def moved(self) -> bool:
        """Whether rows are left out, or lie elsewhere than in the files."""

    def __len__(self) -> int:
        """N."""

    def chosen(self, runs: Int[Array, "K 2"]) -> Rows:
        """The rows ``begin:end`` of each of the `runs`, which are in order, numbered anew from 0."""

    def tables(
        self, first: int, last: int, columns: list[str], demonstration: Place = lambda _: ""
    ) -> Iterator[tuple[int, pa.Table, Place]]:
        """Rows ``first:last`` in tables: the first row of each, the table, and the place of a row of it for messages.

        `demonstration` names the demonstration of a row of the recording.
        """

    def numbers(self, rows: Array) -> Array:
        """The numbers that some rows have in the files, one below the other, from 0."""


@dataclass(frozen=True, eq=False)
class TableRows:
    """The rows of a table in memory, which is called `source` in messages.

    `place` (N,) is the number that each has in the files; None where all stay where they are, and none is left out.
    """

    table: pa.Table
    source: str
    place: Array | None = None
    sizes: Mapping[str, int] = field(default_factory=dict)

    @property
    def schema(self) -> pa.Schema:
        return self.table.schema

    @property
    def moved(self) -> bool:
        return self.place is not None

    def __len__(self) -> int:
        return len(self.table)

    def taken(self, rows: Array) -> TableRows:
        """Some of the rows, in this order."""
        return replace(self, table=self.table.take(rows), place=self.numbers(rows))

    def chosen(self, runs: Int[Array, "K 2"]) -> TableRows:
        if runs.tolist() == [[0, len(self)]]:
            return self
        return self.taken(np.concatenate([np.arange(begin, end) for begin, end in runs.tolist()]))

    def tables(
        self, first: int, last: int, columns: list[str], demonstration: Place = lambda _: ""
    ) -> Iterator[tuple[int, pa.Table, Place]]:
        table, row_of = self.table.select(columns), range(last) if self.place is None else self.place
        for row in range(first, last, BATCH_ROWS):
            here = table.slice(row, min(BATCH_ROWS, last - row))
            yield row, here, shifted(lambda k: f"{self.source}{demonstration(k)}, row {row_of[k] + 1}", row)

    def numbers(self, rows: Array) -> Array:
        return rows if self.place is None else self.place[rows]


def files_of(rows: Rows, some: Array) -> list[str]:
    """The file of each of `some` rows, no two alike; none where files say nothing of demonstrations."""
    names, ends = list(rows.sizes), np.cumsum(list(rows.sizes.values()))
    return [names[k] for k in np.searchsorted(ends, rows.numbers(some), side="right").tolist()] if names else []


def shifted(at: Place, rows: int) -> Place:
    """`at` for a table without its first `rows`."""
    return lambda row: at(rows + row)


def read_columns(rows: Rows, names: list[str], steps: slice | None = None) -> pa.Table:
    """Some columns of some of the rows, or of all."""
    first, last = (0, len(rows)) if steps is None else (steps.start, steps.stop)
    tables = [table for _, table, _ in rows.tables(first, last, names)] if names else []
    return pa.concat_tables(tables, promote_options="permissive") if tables else pa.table({})
