"""The order of the steps of a demonstration, by a column of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.errors import DataError
from rpil.formats.columns import Columns
from rpil.formats.table import Place, kind_of_type
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

NO_NUMBERS = "values that are missing, or neither numbers nor times"
REPEATS = "repeated values within a demonstration"
_FILE_ORDER = "steps in the order of the file"


@dataclass(frozen=True, eq=False)
class Order:
    """The order of the steps within a demonstration."""

    column: str | None = None  # None: as in the file
    values: Array | None = None  # (N,): sorted by these
    words: str = _FILE_ORDER


def find_order(table: pa.Table, columns: Columns, group: Array, at: Place) -> Order:
    """By the first of the likely columns that tells the steps of every demonstration apart.

    `group` (N,) numbers the demonstration of each row. A `DataError` where the user named a column that does not.
    """
    by_group = np.argsort(group, kind="stable") if np.any(group[1:] < group[:-1]) else np.arange(len(group))
    same = group[by_group][1:] == group[by_group][:-1]
    faults: dict[str, str] = {}
    for name in columns.orders:
        values = order_values(table[name])
        if values is None:
            faults[name] = NO_NUMBERS
        else:
            step = values[by_group]
            if np.all(step[1:][same] > step[:-1][same]):
                return Order(name, values, f"steps in the order of {name}")
            rows = np.lexsort([values, group])
            twice = np.flatnonzero((values[rows][1:] == values[rows][:-1]) & (group[rows][1:] == group[rows][:-1]))
            if not len(twice):
                return Order(name, values, f"steps sorted by {name}, because rows of the file are out of order")
            faults[name] = REPEATS
            if columns.order_given:
                row = int(rows[twice[0] + 1])
                raise DataError(f"{at(row)}: order column {name!r} repeats a value; name another, or leave it out.")
        if columns.order_given:
            raise DataError(f"{at(0)}: order column {name!r} needs a number or time in every row; name another.")
    return Order(words=order_words(faults))


def check_one_id(table: pa.Table, columns: Columns, group: Array, order: Order, at: Place) -> None:
    """A `DataError` where the rows of one id seem to be several demonstrations, as where each session counts its own.

    They are one where a column gives the order of its rows, unless they lie together only by a second column.
    """
    n_ids = int(group.max()) + 1
    for name in columns.parts:
        codes = table[name].dictionary_encode().unify_dictionaries().combine_chunks().indices.fill_null(-1).to_numpy()
        pair = group * (len(codes) + 1) + codes
        pairs, first = np.unique(pair, return_index=True)
        n_runs, n_runs_of_ids = (1 + np.count_nonzero(np.diff(numbers)) for numbers in (pair, group))
        together = n_runs == len(pairs) and n_runs_of_ids > n_ids
        if n_ids < len(pairs) <= len(group) / 2 and (order.column is None or together):
            rows = np.sort(first)
            row = int(rows[np.flatnonzero(np.isin(rows, np.unique(group, return_index=True)[1], invert=True))[0]])
            raise DataError(f"{at(row)}: {several_in_one(name, columns.episode)}.")


def several_in_one(name: str, episode: str) -> str:
    """That the column `name` differs within a demonstration, and the remedy."""
    return (
        f"column {name!r} changes within this demonstration; write a column of ids that no two demonstrations share, "
        f"or, if {episode!r} is one, say so with --id or id="
    )


def order_words(faults: Mapping[str, str]) -> str:
    """That no column gives the order, and why the likeliest one does not."""
    name = next(iter(faults), None)
    return _FILE_ORDER if name is None else f"{_FILE_ORDER}, because {name} has {faults[name]}"


def order_values(column: pa.ChunkedArray) -> Array | None:
    """A column as numbers to sort by; None where values are missing, or are neither numbers nor times."""
    kind = kind_of_type(column.type)
    if column.null_count or kind not in ("number", "time"):
        return None
    values = np.asarray(column.to_numpy())
    if values.dtype.kind in "mM":
        values = values.astype(np.int64)
    return values if values.dtype.kind in "iu" or (values.dtype.kind == "f" and np.isfinite(values).all()) else None
