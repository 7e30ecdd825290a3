"""Rows of a recording, read table by table: of a table in memory; `rpil.formats.store` has those of Parquet files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from rpil.formats.table import Place
from rpil.numerics.types import Array, Int

if TYPE_CHECKING:
    import pyarrow as pa

BATCH_ROWS = 65_536
"""Maximum rows per batch."""


class Rows(Protocol):
    """The rows of a recording, those of each demonstration together."""

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

    def numbers(self, steps: slice) -> pa.Table | None:
        """The rows of the file, counted from 1, of some steps, where rows were moved."""

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
        The row of the table that comes at each place; None where all stay where they are, and none is left out.
    sizes : mapping of str to int
        The numbers of rows from each file; empty for formats in which files say nothing of demonstrations.
    """

    table: pa.Table
    source: str
    place: Array | None = None
    sizes: Mapping[str, int] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.table if self.place is None else self.place)

    def chosen(self, runs: Int[Array, "K 2"]) -> TableRows:
        if runs.tolist() == [[0, len(self)]]:
            return self
        rows = np.concatenate([np.arange(begin, end) for begin, end in runs.tolist()])
        return replace(self, place=rows if self.place is None else self.place[rows])

    def tables(
        self, first: int, last: int, columns: list[str], demonstration: Place = lambda _: ""
    ) -> Iterator[tuple[int, pa.Table, Place]]:
        table, row_of = self.table.select(columns), range(last) if self.place is None else self.place
        for row in range(first, last, BATCH_ROWS):
            size = min(BATCH_ROWS, last - row)
            here = table.slice(row, size) if self.place is None else table.take(self.place[row : row + size])
            yield row, here, shifted(lambda k: f"{self.source}{demonstration(k)}, row {row_of[k] + 1}", row)

    def numbers(self, steps: slice) -> pa.Table | None:
        import pyarrow as pa

        return None if self.place is None else pa.table({"row": self.place[steps] + 1})

    def files(self, rows: Array) -> list[str]:
        return names_at(self.sizes, rows if self.place is None else self.place[rows])


@dataclass(frozen=True, eq=False)
class ChosenRows:
    """Some rows of others that stay on disk: those ``begin:end`` of each of the `runs`."""

    rows: Rows
    bounds: Int[Array, "K 2"]

    @cached_property
    def _first(self) -> Int[Array, " _"]:
        """The number here of the first row of each run, and of the one after the last."""
        return np.append(0, np.cumsum(self.bounds[:, 1] - self.bounds[:, 0]))

    def _there(self, rows: Array) -> Array:
        """The numbers of `rows` among the others."""
        k = np.searchsorted(self._first, rows, side="right") - 1
        return np.asarray(self.bounds[k, 0] + rows - self._first[k])

    def _here(self, row: int) -> int:
        """How many of the chosen rows come before the row of this number among the others."""
        k = max(int(np.searchsorted(self.bounds[:, 0], row, side="right")) - 1, 0)
        return int(self._first[k] + np.clip(row - self.bounds[k, 0], 0, self.bounds[k, 1] - self.bounds[k, 0]))

    def __len__(self) -> int:
        return int(self._first[-1])

    def chosen(self, runs: Int[Array, "K 2"]) -> Rows:
        there = self._there(np.concatenate([np.arange(begin, end) for begin, end in runs.tolist()]))
        heads = np.flatnonzero(np.diff(there, prepend=-2) != 1)
        ends = there[np.append(heads[1:], len(there)) - 1] + 1
        return self.rows.chosen(np.stack([there[heads], ends], axis=1))

    def tables(
        self, first: int, last: int, columns: list[str], demonstration: Place = lambda _: ""
    ) -> Iterator[tuple[int, pa.Table, Place]]:
        begin, end = self._there(np.array([first, last - 1])).tolist()
        others = self.rows.tables(begin, end + 1, columns, lambda row: demonstration(self._here(row)))
        for row, table, at in others:
            k, after = np.searchsorted(self.bounds[:, 1], row, side="right"), row + len(table)
            while k < len(self.bounds) and (a := max(int(self.bounds[k, 0]), row)) < after:
                b = min(int(self.bounds[k, 1]), after)
                yield self._here(a), table.slice(a - row, b - a), shifted(at, a - row)
                k += 1

    def numbers(self, steps: slice) -> pa.Table:
        import pyarrow as pa

        return pa.table({"row": self._there(np.arange(steps.start, steps.stop)) + 1})

    def files(self, rows: Array) -> list[str]:
        return self.rows.files(self._there(rows))


def names_at(sizes: Mapping[str, int], rows: Array) -> list[str]:
    """The name of the file of each of some rows, by the numbers of rows from each file; none where there are none."""
    names, ends = list(sizes), np.cumsum(list(sizes.values()))
    return [names[k] for k in np.searchsorted(ends, rows, side="right").tolist()] if names else []


def shifted(at: Place, rows: int) -> Place:
    """`at` for a table without its first `rows`."""
    return lambda row: at(rows + row)


def read_columns(rows: Rows, names: list[str], steps: slice | None = None) -> pa.Table:
    """Some columns of some of the rows, or of all."""
    import pyarrow as pa

    first, last = (0, len(rows)) if steps is None else (steps.start, steps.stop)
    tables = [table for _, table, _ in rows.tables(first, last, names)] if names else []
    return pa.concat_tables(tables, promote_options="permissive") if tables else pa.table({})
