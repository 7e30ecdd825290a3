"""The table of Parquet and CSV files: one row per step; columns that hold data are found by name, others not read."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from rpil.data.arrays import LONGEST_TEXT, are_whole, as_array, check_any
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.memory import check_memory
from rpil.data.text import EPISODE, STEP, action_columns, quoted
from rpil.numerics.types import Array

Kind = Literal["number", "list", "text", "mixed", "time", "empty", "nested"]
"""Kind of a column's values; "mixed" is text in the place of some numbers."""

Place = Callable[[int], str]
"""The place of a row of a table in messages: its file, demonstration and number."""

BATCH_ROWS = 65_536
"""Maximum rows per batch."""

WIDEST, NESTED = 10_000, "images or nested values"  # numbers in a list that is no image, and what is no list

HEAD_ROWS = 1000
"""Rows by which the kinds of columns are told."""


def kinds_of(head: pa.Table, decimal: str = ".") -> dict[str, Kind]:
    """The kind of each column by its type and first values, with this `decimal` sign; all may be numbers of no rows."""
    found = {field.name: kind_of_type(field.type) if len(head) else "number" for field in head.schema}
    for name in (name for name, kind in found.items() if kind == "text"):
        texts = [text.strip() for text in head[name].unique().to_pylist() if text]
        if texts and 2 * sum(is_number(text, decimal) for text in texts) >= len(texts):
            found[name] = "mixed"
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
    is_list = pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    return "list" if is_list and _is_numeric(kind.value_type) else "nested"


def from_demonstrations(demonstrations: Demonstrations, truth: Mapping[str, Array]) -> pa.Table:
    """The table that `rpil.read` reads back, with one more column for each `truth`, (M,) or (N,)."""
    columns = step_columns(demonstrations.ids, demonstrations.offsets)
    for name, column in zip(demonstrations.observation_names, demonstrations.observations.T, strict=True):
        columns[f"observation.{name}"] = column
    if demonstrations.is_discrete:
        columns["action"] = demonstrations.actions
    else:
        names = action_columns(demonstrations.action_names, demonstrations.n_actions)
        columns |= zip(names, demonstrations.actions.T, strict=True)
    n, lengths = demonstrations.n_steps, demonstrations.lengths
    return pa.table(columns | {m: v if len(v) == n else np.repeat(v, lengths) for m, v in truth.items()})


def step_columns(ids: Sequence[object], offsets: Array) -> dict[str, Array]:
    """The two columns that identify a step: the id of its demonstration, and its number within it, from 0."""
    lengths = np.diff(offsets)
    numbers = np.arange(offsets[-1]) - np.repeat(offsets[:-1], lengths)
    return {EPISODE[0]: np.repeat(np.array(ids), lengths), STEP: numbers}


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


def part_names(name: str, width: int, names: Sequence[str] = ()) -> tuple[str, ...]:
    """The columns of the numbers in a list `name` of this width, by their own `names` if there is one for each."""
    own = map(str, names if len(names) == len({*names}) == width else range(width))
    return (name,) if width == 1 else tuple(f"{name}.{part}" for part in own)


def parts_of_lists(head: pa.Table, names: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
    """The columns of the numbers in each list of a table, whose first rows say how many these are; none of images."""
    lists = {field.name: head[field.name] for field in head.schema if kind_of_type(field.type) == "list"}
    first = {name: next((row for row in column if row.is_valid), ()) for name, column in lists.items()}
    widths = {name: len(row) for name, row in first.items()}
    return {m: part_names(m, width, names.get(m, ())) for m, width in widths.items() if 0 < width <= WIDEST}


def flattened(table: pa.Table, lists: Mapping[str, Sequence[str]], wanted: Sequence[str]) -> pa.Table:
    """The `wanted` columns, of which those of numbers in `lists` have no value where a row has more or fewer."""
    columns, chosen = dict[str, Any](zip(table.column_names, table.columns, strict=True)), {*wanted}
    for name in [name for name in lists if name in columns and kind_of_type(columns[name].type) == "list"]:
        column, parts = columns[name], lists[name]
        column = column.combine_chunks() if column.num_chunks != 1 else column.chunk(0)
        fits = pc.fill_null(pc.equal(pc.list_value_length(column), len(parts)), False).to_numpy(zero_copy_only=False)
        if not fits.all():
            column = column.take(pa.array(np.arange(len(column)), mask=~fits))
        if column.null_count or (values := column.flatten()).null_count or not _is_numeric(values.type):
            columns |= {part: pc.list_element(column, k) for k, part in enumerate(parts) if part in chosen}
            continue
        rows = values.to_numpy(zero_copy_only=False).reshape(-1, len(parts))
        matrix, n = np.empty(rows.shape[::-1], rows.dtype), 4 * HEAD_ROWS
        for k in range(0, len(rows), n):  # in blocks that stay in the cache
            matrix[:, k : k + n] = rows[k : k + n].T
        columns |= {part: pa.array(own) for part, own in zip(parts, matrix, strict=True) if part in chosen}
    return pa.table(columns).select(wanted)


def is_number(text: str, decimal: str = ".") -> bool:
    try:
        float(text.replace(decimal, "."))
    except ValueError:
        return False
    return True


def column_values(table: pa.Table, name: str, at: Place, allows_missing: bool = False) -> Array:
    """One column as (N,) numbers or text; a `DataError` on values of another type, and on missing ones, unless they are
    allowed as NaN."""
    column = table[name]
    is_text = kind_of_type(column.type) == "text"
    if pa.types.is_dictionary(column.type) and not is_text:
        column = column.cast(column.type.value_type)
    if column.null_count and allows_missing and (numbers := numbers_or_missing(column)) is not None:
        return numbers
    if column.null_count:
        row = pc.index(pc.is_null(column), True).as_py()
        raise DataError(f"{at(row)}: column {name!r} has no value; fill it in, or read with --exclude or --skip-bad.")
    if _is_numeric(column.type):
        whole = column.chunk(0) if column.num_chunks == 1 else column  # of which no copy is made
        return np.asarray(whole.to_numpy(zero_copy_only=False))
    if pa.types.is_decimal(column.type):
        return np.asarray(column.cast(pa.float64()).to_numpy())
    if is_text:
        texts, rows = encoded_texts(column, name, at)
        check_memory(4.0 * len(rows) * max(map(len, texts), default=0), at(0))
        return np.asarray(as_array(texts, f"the texts of column {name!r}", at(0))[rows])
    raise DataError(f"{at(0)}: column {name!r} holds {column.type} where numbers or text are due; convert or drop it.")


def encoded(column: pa.ChunkedArray) -> tuple[list[Any], Array]:
    """The different values in a column, and the number (N,) of that of each row, -1 where it has none."""
    whole = column.dictionary_encode().unify_dictionaries().combine_chunks()
    return whole.dictionary.to_pylist(), whole.indices.fill_null(-1).to_numpy()


def encoded_texts(column: pa.ChunkedArray, name: str, at: Place) -> tuple[list[str], Array]:
    """The different texts in a column, and the number (N,) of that of each row: a long text is in memory once. A
    `DataError` where a text is missing, too long or not Unicode."""
    try:
        texts, rows = encoded(column)
    except UnicodeDecodeError as error:
        raise DataError(f"{at(0)}: column {name!r} holds text that is not Unicode; write it again.") from error
    for k, text in enumerate(texts):
        if text is None or len(text) > LONGEST_TEXT:
            fault = f"holds a text of {len(text):,} characters; shorten it" if text else "has no value; fill it in"
            raise DataError(f"{at(int(np.argmax(rows == k)))}: column {name!r} {fault}.")
    return texts, rows


def first_rows(group: Array, codes: Array) -> Array:
    """The first row of each different pair of two whole numbers (N,), in the order of the rows."""
    heads = np.append(0, 1 + np.flatnonzero((group[1:] != group[:-1]) | (codes[1:] != codes[:-1])))
    pairs = group[heads].astype(np.int64) * (len(codes) + 1) + codes[heads]
    return heads[np.sort(np.unique(pairs, return_index=True)[1])]


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
        if not are_whole(values := column.to_numpy()):
            row = int(np.argmin(np.isfinite(values) & (values == np.round(values))))
            said = f"demonstration ids must be whole numbers or text; fill in the missing ones of {name!r}"
            raise DataError(f"{at(row)}: {said}.")
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
    """A column as (N,) floats with NaN for missing values; None where it holds no numbers."""
    if kind_of_type(column.type) != "number":
        return None
    floats = column if pa.types.is_floating(column.type) else column.cast(pa.float64(), safe=False)
    whole = floats.chunk(0) if floats.num_chunks == 1 else floats  # of which no copy is made
    return np.asarray(whole.to_numpy(zero_copy_only=False))


def order_values(column: pa.ChunkedArray) -> Array | None:
    """A column of numbers, times or texts of times as numbers to sort by; None where values are missing or others."""
    kind = kind_of_type(column.type)
    for zone in (None, "UTC") if kind == "text" else ():
        with suppress(pa.ArrowException):  # of texts that are no times as ISO 8601 writes them
            column, kind = column.cast(pa.timestamp("us", zone)), "time"
    if column.null_count or kind not in ("number", "time"):
        return None
    values = np.asarray(column.to_numpy())
    if values.dtype.kind in "mM":
        values = values.astype(np.int64)
    return values if values.dtype.kind in "iu" or (values.dtype.kind == "f" and np.isfinite(values).all()) else None


def _is_numeric(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind))
