"""The table of Parquet and CSV files: one row per step; columns that hold data are found by name, others not read."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from rpil.data.arrays import LONGEST_TEXT, are_whole, as_array, check_any
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.memory import check_memory
from rpil.data.names import EPISODE, STEP, action_columns, quoted, short_name
from rpil.numerics.types import Array

Kind = Literal["number", "list", "text", "written list", "mixed", "time", "counter", "empty", "nested"]
"""Kind of a column's values; "mixed" is text in the place of some numbers, "counter" the number of the row."""

Place = Callable[[int], str]
"""The place of a row of a table in messages: its file, demonstration and number."""

_WRITTEN = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?"
_WRITTEN_LIST = re.compile(rf"\[.*\]|\(?{_WRITTEN}(?:(?:\s*[,;]\s*|\s+){_WRITTEN})+\)?", re.IGNORECASE | re.DOTALL)
"""Numbers in one text, as "0.1, 0.2"; where all are whole, as in "1 0", it may be a class."""

BATCH_ROWS = 65_536
"""Maximum rows per batch."""

HEAD_ROWS = 1000
"""Rows by which the kinds of columns are told."""


def kinds_of(head: pa.Table) -> dict[str, Kind]:
    """The kind of every column by its type and its first values; of none where there are no values."""
    found = {field.name: kind_of_type(field.type) for field in head.schema} if head.num_rows else {}
    for name, kind in found.items():
        if kind == "text":
            texts = [text.strip() for text in head[name].unique().to_pylist() if text]
            if any("[" in text or "." in text for text in texts) and all(map(_WRITTEN_LIST.fullmatch, texts)):
                found[name] = "written list"
            elif texts and 2 * sum(map(is_number, texts)) >= len(texts):
                found[name] = "mixed"
        elif kind == "number" and len(head) >= _COUNTED_ROWS and head[name][0].as_py() in (0, 1):
            values = np.asarray(head[name].to_numpy(), dtype=float)
            found[name] = "counter" if np.array_equal(values, values[0] + np.arange(len(head))) else kind
    return found


def kind_of_type(kind: pa.DataType) -> Kind:
    """The kind of a column by its type."""
    kind = plain_type(kind)
    if pa.types.is_null(kind):
        return "empty"
    if _is_numeric(kind) or pa.types.is_decimal(kind):
        return "number"
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return "text"
    if pa.types.is_temporal(kind):
        return "time"
    return "list" if _is_list(kind) and _is_numeric(kind.value_type) else "nested"


_COUNTED_ROWS = 30
"""Rows that go up by one from 0 or 1, through all demonstrations, before a column is taken for their number."""


def from_demonstrations(demonstrations: Demonstrations, truth: Mapping[str, Array]) -> pa.Table:
    """The ``pyarrow.Table`` that `to_demonstrations` reads back, with one more column for each `truth` (M,)."""
    columns = step_columns(demonstrations.ids, demonstrations.offsets)
    for name, column in zip(demonstrations.observation_names, demonstrations.observations.T, strict=True):
        columns[f"observation.{name}"] = column
    if demonstrations.is_discrete:
        columns["action"] = demonstrations.actions
    else:
        names = action_columns(demonstrations.action_names, demonstrations.n_actions)
        columns |= zip(names, demonstrations.actions.T, strict=True)
    return pa.table(columns | {name: np.repeat(values, demonstrations.lengths) for name, values in truth.items()})


def step_columns(ids: Sequence[object], offsets: Array) -> dict[str, Array]:
    """The two columns that identify a step: the id of its demonstration, and its number within it, from 0."""
    lengths = np.diff(offsets)
    return {
        EPISODE[0]: np.repeat(np.array(ids), lengths),
        STEP: np.arange(offsets[-1]) - np.repeat(offsets[:-1], lengths),
    }


def end_to_end(tables: Sequence[pa.Table], source: str) -> pa.Table:
    """Tables one below the other; a `DataError` where there is none, or where their columns differ."""
    check_any(len(tables), source)
    try:
        return pa.concat_tables(tables, promote_options="permissive")
    except pa.ArrowException as error:
        raise DataError(f"{source}: its demonstrations have columns of different types; write them alike.") from error


def other_columns(name: str, first: str, names: Collection[str] = (), known: Collection[str] = ()) -> DataError:
    """The error that the file `name` has other columns, these `names`, than the file `first`."""
    differ = (quoted(sorted({*some} - {*others}), 5) for some, others in ((known, names), (names, known)))
    which = " and ".join(f"{what} {some}" for what, some in zip(("without", "with"), differ, strict=True) if some)
    said = f"its columns are not those of {first}{which and f' ({which})'}"
    return DataError(f"{name}: {said}; give all files the same ones, or take it out.")


def plain_type(kind: pa.DataType) -> pa.DataType:
    """The type of the values of a column that may be encoded by a dictionary."""
    return kind.value_type if pa.types.is_dictionary(kind) else kind


def part_names(widths: Mapping[str, int], joints: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """A name for every number in columns of these `widths`; no two alike."""
    found = list[str]()
    for name, width in widths.items():
        short, own = short_name(name), joints.get(name, ())
        each = map(str, own if len(own) == width else range(width))
        found += [short or "0"] if width == 1 else [f"{short}.{part}" if short else part for part in each]
    if len(set(found)) < len(found):
        return tuple(f"{name}.{k}" for name, width in widths.items() for k in range(width))
    return tuple(found)


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def column_values(table: pa.Table, name: str, at: Place, allows_missing: bool = False) -> Array:
    """One column as (N,) numbers or text, or as (N, K) numbers where it holds lists.

    A `DataError` on missing values, unless they are allowed as NaN, lists of unequal length, or values of another type.
    """

    def refuse_nulls(column: pa.ChunkedArray | pa.Array, per_row: int = 1) -> None:
        if column.null_count:
            row = pc.index(pc.is_null(column), True).as_py() // per_row
            raise DataError(f"{at(row)}: column {name!r} has no value; fill it in, or read with <option>.", "skip_bad")

    column = table[name]
    is_text = kind_of_type(column.type) == "text"
    if pa.types.is_dictionary(column.type) and not is_text:
        column = column.cast(column.type.value_type)
    if not (pa.types.is_floating(column.type) and allows_missing):
        refuse_nulls(column)
    if _is_list(column.type):
        widths = pc.list_value_length(column).to_numpy()
        if np.any(widths != widths[0]):
            row = int(np.argmax(widths != widths[0]))
            raise DataError(f"{at(row)}: column {name!r} holds {widths[row]} numbers, not {widths[0]} as in row 1.")
        flat = column.combine_chunks().flatten()
        if not (pa.types.is_floating(flat.type) and allows_missing):
            refuse_nulls(flat, per_row=max(int(widths[0]), 1))
        if _is_numeric(flat.type):
            return np.reshape(flat.to_numpy(zero_copy_only=False), (table.num_rows, -1))
    elif _is_numeric(column.type):
        return np.asarray(column.to_numpy())
    elif pa.types.is_decimal(column.type):
        return np.asarray(column.cast(pa.float64()).to_numpy())
    elif is_text:
        texts, rows = encoded_texts(column, name, at)
        check_memory(4.0 * len(rows) * max(map(len, texts), default=0), at(0))
        return np.asarray(as_array(texts, f"the texts of column {name!r}", at(0))[rows])
    raise DataError(f"{at(0)}: column {name!r} holds {column.type} where numbers or text are due; convert or drop it.")


def encoded(column: pa.ChunkedArray) -> tuple[list[Any], Array]:
    """The different values in a column, and the number (N,) of that of each row, -1 where it has none."""
    whole = column.dictionary_encode().unify_dictionaries().combine_chunks()
    return whole.dictionary.to_pylist(), whole.indices.fill_null(-1).to_numpy()


def encoded_texts(column: pa.ChunkedArray, name: str, at: Place) -> tuple[list[str], Array]:
    """The different texts in a column, and the number (N,) of that of each row: a long text is in memory once.

    A `DataError` where a text is missing, too long or not Unicode.
    """
    try:
        texts, rows = encoded(column)
    except UnicodeDecodeError as error:
        raise DataError(f"{at(0)}: column {name!r} holds text that is not Unicode; write it again.") from error
    for k, text in enumerate(texts):
        if text is None or len(text) > LONGEST_TEXT:
            fault = f"holds a text of {len(text):,} characters; shorten it" if text else "has no value; fill it in"
            raise DataError(f"{at(int(np.argmax(rows == k)))}: column {name!r} {fault}.")
    return texts, rows


def id_codes(table: pa.Table, name: str, at: Place) -> tuple[list[int | str], Array]:
    """The different ids in a column, and the number (N,) of that of each row.

    Text is never an array of NumPy, which drops trailing NULs and takes the longest id's memory for every row. A
    `DataError` where ids are missing, or neither whole numbers nor text.
    """
    column = table[name]
    if column.null_count:
        row = pc.index(pc.is_null(column), True).as_py()
        raise DataError(f"{at(row)}: column {name!r} has no value; fill it in or leave the demonstration out.")
    if pa.types.is_floating(column.type):
        if not are_whole(column.to_numpy()):
            raise DataError(f"{at(0)}: demonstration ids must be whole numbers or text; fill in the missing ones.")
        column = column.cast(pa.int64())
    elif pa.types.is_decimal(column.type) or pa.types.is_temporal(column.type):
        column = column.cast(pa.string())
    kind = kind_of_type(column.type)
    if kind not in ("number", "text"):
        raise DataError(f"{at(0)}: column {name!r} holds {column.type}; demonstration ids must be numbers or text.")
    if kind == "text":
        texts, rows = encoded_texts(column, name, at)
        return list(texts), rows
    return encoded(column)


def numbers_or_missing(column: pa.ChunkedArray) -> Array | None:
    """A column as (N, K) floats with NaN for missing values; None for text, and for lists of unequal length."""
    kind, n_rows, width = kind_of_type(column.type), len(column), 1
    if kind == "list":
        widths = pc.list_value_length(column)
        if column.null_count or pc.count_distinct(widths).as_py() != 1:
            return None
        width, column = widths[0].as_py(), column.combine_chunks().flatten()
    if kind not in ("list", "number"):
        return None
    floats = column if pa.types.is_floating(column.type) else column.cast(pa.float64(), safe=False)
    return np.reshape(floats.to_numpy(zero_copy_only=False), (n_rows, width))


def order_values(column: pa.ChunkedArray) -> Array | None:
    """A column as numbers to sort by; None where values are missing, or are neither numbers nor times."""
    kind = kind_of_type(column.type)
    if column.null_count or kind not in ("number", "time"):
        return None
    values = np.asarray(column.to_numpy())
    if values.dtype.kind in "mM":
        values = values.astype(np.int64)
    return values if values.dtype.kind in "iu" or (values.dtype.kind == "f" and np.isfinite(values).all()) else None


def padded(column: pa.ChunkedArray, width: int) -> Array:
    """A column as (N, width) numbers, with NaN where a number, or list of as many, is missing; texts are 0 or NaN."""
    values = numbers_or_missing(column)
    if values is not None and values.shape[1] == width:
        return values
    if kind_of_type(column.type) == "list":
        lists = (row if row is not None and len(row) == width else [None] * width for row in column.to_pylist())
        return np.array([*lists], dtype=float).reshape(-1, width)
    return np.where(column.is_null().to_numpy(), np.nan, 0.0)[:, None]


def _is_list(kind: pa.DataType) -> bool:
    return bool(pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind))


def _is_numeric(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind))
