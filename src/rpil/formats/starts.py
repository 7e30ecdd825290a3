"""Where the demonstrations of a data set begin, and whether their rows are in order, read table by table."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rpil.data.arrays import Id, as_ids
from rpil.data.errors import DataError
from rpil.data.memory import check_memory
from rpil.formats import table as flat
from rpil.formats.columns import Columns
from rpil.formats.order import NO_NUMBERS, REPEATS, Order, order_values, order_words, several_in_one
from rpil.formats.rows import Rows
from rpil.formats.table import Place
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

_BYTES_PER_ID = 200  # of a demonstration: its id as an object of Python, and its place


class Starts:
    """Collects the first row and the id of every demonstration."""

    def __init__(self, column: str) -> None:
        self._column = column
        self._starts: list[Array] = []
        self._ids: list[Id] = []
        self._n_rows = 0

    def add(self, row: int, table: pa.Table, at: Place) -> Array:
        """Add the rows from number `row` on; the rows of the table, (K,), at which a demonstration begins."""
        names, codes = flat.id_codes(table, self._column, at)
        first = self._ids[-1:] != [names[codes[0]]]
        if self._ids and isinstance(self._ids[-1], str) != isinstance(names[0], str):
            raise DataError(f"{at(0)}: demonstration ids must be all whole numbers or all text.")
        begins = np.flatnonzero(np.append(first, codes[1:] != codes[:-1]))
        self._starts.append(row + begins)
        self._ids += [names[k] for k in codes[begins].tolist()]
        self._n_rows = row + len(table)
        check_memory(_BYTES_PER_ID * len(self._ids), at(0))
        return begins

    def finish(self, rows: Rows, column: str, source: str) -> tuple[tuple[Id, ...], NDArray[np.int64]]:
        """The ids, and the offsets, once all rows were added."""
        starts = np.concatenate(self._starts)
        seen: dict[Id, int] = {}
        for m, name in enumerate(self._ids):
            k = seen.setdefault(name, m)
            if k != m:
                first, second = (rows.file_of(int(starts[n])) for n in (k, m))
                remedy = f"it is both in {first} and in {second}; give each demonstration its own id, in one file"
                if first == second:
                    remedy = (
                        f"its rows lie apart in {first}; sort them by {column}, or read them into memory with "
                        "--no-stream or rpil.read; if they are several demonstrations, give each its own id"
                    )
                raise DataError(f"{source}, demonstration {name!r}: {remedy}.")
        return as_ids(self._ids, source), np.append(starts, self._n_rows).astype(np.int64)


class OrderCheck:
    """Whether the rows of the demonstrations are in the order of a column."""

    def __init__(self, columns: Columns) -> None:
        self._last: dict[str, Array] = {name: np.empty(0) for name in columns.orders}
        self._faults: dict[str, str] = {}  # of a column that gives no order
        self._disorder: dict[str, str] = {}  # place of the first row that is out of order
        self._columns = columns
        self._several = ""  # fault of the first row that seems to begin another demonstration of the same id
        self._n_changes, self._n_rows = 0, 0  # rows that seem so, of all

    def add(self, table: pa.Table, begins: Array, at: Place) -> None:
        """Add the rows of a table, in which demonstrations begin at the rows `begins`."""
        import pyarrow.compute as pc

        goes_on = np.ones(len(table), dtype=bool)
        goes_on[begins] = False
        self._n_rows += len(table)
        for name in self._columns.parts:
            changed = pc.fill_null(pc.not_equal(table[name].slice(1), table[name].slice(0, len(table) - 1)), False)
            changes = np.flatnonzero(changed.to_numpy() & goes_on[1:])
            self._n_changes += len(changes)
            if len(changes) and not self._several:
                self._several = f"{at(int(changes[0]) + 1)}: {several_in_one(name, self._columns.episode)}."
        for name in self._last.keys() - self._faults.keys():
            values = order_values(table[name])
            if values is None:
                self._faults[name] = NO_NUMBERS
                continue
            before = np.append(self._last[name] if len(self._last[name]) else values[:1], values[:-1])
            self._last[name] = values[-1:]
            if np.any(goes_on & (values == before)):
                self._faults[name] = REPEATS
            back = np.flatnonzero(goes_on & (values < before))
            if len(back):
                self._disorder.setdefault(name, at(int(back[0])))

    def finish(self, source: str) -> Order:
        """The order, once all rows were added; a `DataError` where rows are out of order."""
        for name in self._last:
            if name in self._faults:
                continue
            if name in self._disorder:
                raise DataError(
                    f"{self._disorder[name]}: rows are not in the order of {name!r}; sort the file, read it into "
                    "memory with --no-stream or rpil.read, or name another column with order."
                )
            return Order(name, None, f"steps in the order of {name}")
        if 0 < self._n_changes <= self._n_rows / 2:
            raise DataError(self._several)
        return Order(words=order_words(self._faults))
