"""Tables of Arrow: of data frames, and of the formats whose files hold one table for each demonstration."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import pyarrow as pa

from rpil.data.guard import guarded
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions, check_names
from rpil.formats.format import StepTables
from rpil.formats.guesses import GUESSED_ROWS
from rpil.formats.recording import Recording, from_tables
from rpil.formats.table_facts import Origin


@runtime_checkable
class Frame(Protocol):
    """A data frame of pandas, polars, pyarrow or another library that gives its columns to Arrow."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """Its columns."""


def read_frame(frame: Frame, options: ColumnOptions = ColumnOptions()) -> Recording:
    """The recording in a data frame with one row for each step; a `DataError` where Arrow has no type for a column."""
    source = "the frame"
    with guarded(source, "a column holds values of mixed types", "convert them"):
        # A table is none to convert: before pyarrow 25 the copy of a column of text views ended the process.
        table = frame if isinstance(frame, pa.Table) else pa.table(frame)
    return from_tables(from_arrow(table, options, source, "data frame"), options)


def from_arrow(
    table: pa.Table, options: ColumnOptions, source: str, format_name: str, default_id: str | None = None
) -> StepTables:
    """The recording in a table with one row for each step, whose columns are found by name; see `find_columns`."""
    table = plain_columns(table)
    check_names(table.column_names, source)
    kinds = {field.name: flat.kind_of_type(field.type) for field in table.schema}
    head = table.select([name for name, kind in kinds.items() if kind in ("number", "text")]).slice(0, GUESSED_ROWS)
    kinds |= flat.kinds_of(head.slice(0, flat.HEAD_ROWS))
    columns = find_columns(table.column_names, kinds, source, options, default_id, head)
    chosen = table.select([*columns.all, *columns.may_be_outcomes])
    return StepTables([chosen], columns, Origin(source, format_name))


def plain_columns(table: pa.Table) -> pa.Table:
    """A column for each part of a structure, such as ``observation.pos``, and text as files have it."""
    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    for k, field in enumerate(table.schema):
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        if pa.types.is_string_view(kind):
            table = table.set_column(k, field.name, table[k].cast(pa.string()))
    return table
