"""Columns that are made of others: demonstrations that end at pauses, and the times in the names of pictures."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.json_files import Parsed
from rpil.formats import table as flat
from rpil.formats.columns import STRETCH, ColumnOptions, Columns
from rpil.formats.guesses import TIME_OF_DAY
from rpil.formats.times import unit_of
from rpil.numerics.types import Array, Float, Int

if TYPE_CHECKING:
    from rpil.formats.format import StepTables

_TIMESTAMP = "timestamp"
"""The column of the times in texts."""


def with_facts(
    tables: Iterable[pa.Table], episode: str, facts: Mapping[str, Mapping[str, Parsed]]
) -> Iterator[pa.Table]:
    """The tables with a column for each of the `facts`, which have a value for each id."""
    for table in tables:
        encoded = table[episode].dictionary_encode().unify_dictionaries().combine_chunks()
        ids = [str(name) for name in encoded.dictionary.to_pylist()]
        for name, by_id in facts.items():
            table = table.append_column(name, pa.array([by_id.get(m) for m in ids]).take(encoded.indices))
        yield table


def made(found: StepTables, options: ColumnOptions) -> StepTables:
    """The tables with the shorter demonstrations that the options make.

    A demonstration ends where the next row is more than `split_gap` seconds later, or earlier: "P01" is split into
    "P01-0" and "P01-1"; and after each `segment` seconds: into "P01 [0, 10) s" and "P01 [10, 20) s". A `DataError`
    where no column is a time whose unit is known.
    """
    columns, tables = found.columns, iter(found.tables)
    first = next(tables, None) if options.split_gap or options.segment else None
    if first is None:
        return found
    clock, unit = _find_clock(first, columns)
    split: Iterable[pa.Table] = chain([first], tables)
    if flat.kind_of_type(first[clock].type) == "text":
        split = map(partial(_with_times, name=clock, source=columns.source), split)
        columns = replace(columns, orders=(_TIMESTAMP,), times=tuple(name for name in columns.times if name != clock))
        clock, unit = _TIMESTAMP, 1e-3
    others = tuple(name for name in columns.made if name != STRETCH)
    renamed, notes = replace(columns, parts=(), id_chosen=True, made=others), list[str]()
    if options.split_gap:
        notes.append(f"A demonstration ends where more than {options.split_gap:g} s pass, or time starts again.")
        split = _split(split, columns, options.split_gap, clock, unit)
    if options.segment:
        notes.append(f"Each stretch of {options.segment:g} s is a demonstration.")
        split = _divided(split, renamed if options.split_gap else columns, options.segment, clock, unit)
    origin = replace(found.origin.only(()), notes=(*notes, *found.origin.notes))
    return replace(found, tables=split, columns=renamed, origin=origin, in_place=None)


def _find_clock(table: pa.Table, columns: Columns) -> tuple[str, float]:
    """The column of time, by the first table, and the seconds in a tick of it."""
    for name in (*columns.orders, *columns.times):
        column = table[name].drop_null()
        if flat.kind_of_type(column.type) == "text":
            return name, 1.0
        values = np.asarray(column.to_numpy())
        values = values.astype(np.int64) if values.dtype.kind in "mM" else values
        if len(values) and (unit := unit_of(name, column.type, values)) is not None:
            return name, unit
    said = "no column is a time in seconds, which ends demonstrations: name one timestamp, or time_ms, or name it with"
    raise DataError(f"{columns.source}: {said} <option>.", "order")


def _split(tables: Iterable[pa.Table], columns: Columns, gap: float, clock: str, unit: float) -> Iterator[pa.Table]:
    """The tables with new ids."""
    is_new, counts = columns.episode in columns.made, Counter[object]()
    last_time, last_id, label = np.nan, object(), 0 if is_new else ""
    for table in (one for one in tables if len(one)):
        seconds = _seconds(table[clock], unit)
        names, codes = _ids(table, columns)
        steps = np.diff(seconds, prepend=last_time)
        starts = (steps > gap) | (steps < 0) | (np.diff(codes, prepend=codes[0]) != 0)
        starts[0] |= last_id != names[codes[0]]
        labels = [label]
        for name in (names[codes[row]] for row in np.flatnonzero(starts)):
            labels.append(counts[name] if is_new else f"{name}-{counts[name]}")
            counts[name] += 1
        last_time, last_id, label = seconds[-1], names[codes[-1]], labels[-1]
        yield _with_ids(table, columns, pa.array(labels).take(pa.array(np.cumsum(starts))))


def _divided(
    tables: Iterable[pa.Table], columns: Columns, length: float, clock: str, unit: float
) -> Iterator[pa.Table]:
    """The tables with ids of stretches of so many seconds, which count from the first row of each demonstration."""
    first: dict[Id, float] = {}
    for table in (one for one in tables if len(one)):
        seconds = _seconds(table[clock], unit)
        if np.isnan(seconds).any():
            raise DataError(f"{columns.source}: column {clock!r} lacks values; fill it in.")
        names, codes = _ids(table, columns)
        for k, row in zip(*np.unique(codes, return_index=True), strict=True):
            first.setdefault(names[k], float(seconds[row]))
        part = np.floor((seconds - np.array([first.get(name, 0.0) for name in names])[codes]) / length)
        pairs, rows = np.unique(np.stack([codes, part]), axis=1, return_inverse=True)
        said = (f"{names[int(k)]} [{p * length:.10g}, {(p + 1) * length:.10g}) s" for k, p in pairs.T.tolist())
        yield _with_ids(table, columns, pa.array(said).take(pa.array(rows.reshape(-1))))


def _ids(table: pa.Table, columns: Columns) -> tuple[list[Id], Int[Array, " N"]]:
    """The different ids, and the number of that of each row; one id where no column tells demonstrations apart."""
    if columns.episode in columns.made:
        return [0], np.zeros(len(table), dtype=int)
    return flat.id_codes(table, columns.episode, lambda row: f"{columns.source}, row {row + 1}")


def _with_ids(table: pa.Table, columns: Columns, ids: pa.Array) -> pa.Table:
    """The table with new ids."""
    there = columns.episode in table.column_names
    return (table.drop_columns([columns.episode]) if there else table).append_column(columns.episode, ids)


def _with_times(table: pa.Table, name: str, source: str) -> pa.Table:
    """The table with the times in the texts of a column in its place."""
    found = [re.search(TIME_OF_DAY, text or "") for text in table[name].to_pylist()]
    if None in found:
        raise DataError(f"{source}: a text has no time such as 2021_10_25_16_31_20_658; correct it.")
    parts = ([part.replace("_", "-") for part in one.groups("000")] for one in found if one)
    moments = np.array(["{}T{}:{}:{}.{}".format(*own) for own in parts], dtype="datetime64[ms]")
    return table.drop_columns([name]).append_column(_TIMESTAMP, pa.array(moments))


def _seconds(column: pa.ChunkedArray, unit: float) -> Float[Array, " N"]:
    """A column of time in seconds; NaN where it has no value."""
    if flat.kind_of_type(column.type) == "time":
        is_missing = np.asarray(column.is_null().to_numpy(zero_copy_only=False), dtype=bool)
        return np.where(is_missing, np.nan, column.to_numpy().astype(np.int64) * unit)
    return np.asarray(column.cast(pa.float64(), safe=False).to_numpy()) * unit
