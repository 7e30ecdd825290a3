"""The record of a format, with which the module of the format ends; and what one reads."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Protocol, runtime_checkable

import pyarrow as pa

from rpil.data.demonstrations import Demonstrations
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions, Columns, check_names
from rpil.formats.metadata import Metadata
from rpil.formats.steps import ArrowFile
from rpil.numerics.types import Array


@runtime_checkable
class Frame(Protocol):
    """A data frame of pandas, polars, pyarrow or another library that gives its columns to Arrow."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """Its columns."""


@dataclass(frozen=True, eq=False)
class StepTables:
    """Result of a reader: tables one below the other, with a row for each step, and what the files say beside them."""

    tables: Iterable[pa.Table] | ArrowFile  # read one by one; or a file of them
    columns: Columns
    source: str  # the name of the data in messages
    format_name: str
    sizes: Mapping[str, int] = field(default_factory=dict)  # rows of each file, where files may state an order
    metadata: Metadata = Metadata()
    notes: tuple[str, ...] = ()  # what a user should know, in sentences
    ignored: Mapping[str, str] = field(default_factory=dict)  # parts of the file that are no columns, and why
    skipped: tuple[str, ...] = ()  # damaged files, which are not read


def from_arrow(
    tables: Iterable[pa.Table], options: ColumnOptions, source: str, format_name: str, default_id: str | None = None
) -> StepTables:
    """The recording in tables with a row for each step, whose columns are found by name in the first; see
    `find_columns`."""
    waiting = map(plain_columns, tables)
    table = next(waiting, pa.table({}))
    check_names(table.column_names, source)
    kinds = {field.name: flat.kind_of_type(field.type) for field in table.schema}
    head = table.select([name for name, kind in kinds.items() if kind in ("number", "text")]).slice(0, flat.HEAD_ROWS)
    kinds |= flat.kinds_of(head)
    lists = flat.parts_of_lists(table, {})
    kinds |= {name: "nested" for name, kind in kinds.items() if kind == "list" and name not in lists}
    columns = find_columns(table.column_names, kinds, source, options, default_id, lists)
    every = chain([table], waiting)
    chosen = (flat.flattened(one.select(columns.stored), lists, columns.all) for one in every)
    return StepTables(chosen, columns, source, format_name)


def plain_columns(table: pa.Table) -> pa.Table:
    """A column for each part of a structure, such as ``observation.pos``, and text as files have it."""
    while any(map(pa.types.is_struct, table.schema.types)):
        table = table.flatten()
    for k, one in enumerate(table.schema):
        kind = flat.plain_type(one.type)
        if pa.types.is_string_view(kind):
            table = table.set_column(k, one.name, table[k].cast(pa.string()))
    return table


Keep = Callable[[Path, Path, Set[str], ColumnOptions], object]
"""Writes the demonstrations of these ids, as text, in the order of the file, with all that it says of them. All of them
are there; so is the output, empty, where it is a folder."""


def called(*suffixes: str) -> Callable[[Path], bool]:
    """Whether a path is a file whose name ends so."""
    return lambda path: path.is_file() and path.name.lower().endswith(suffixes)


@dataclass(frozen=True)
class Defect:
    """Something of a folder that does not agree with its data; `place` is a file, or an episode."""

    what: str
    place: str
    sentence: str


@dataclass(frozen=True)
class Shot:
    """Where a camera's frames of an episode are: a file, and seconds in it; `n_rows` are those of the data."""

    camera: str
    episode: int
    path: Path
    start: float
    end: float
    n_rows: int


@dataclass(frozen=True)
class Format:
    """The abilities of a format; what is left out of the record, it cannot."""

    name: str  # in messages
    # Whether the file or folder there has this format: False if unsure, and a `DataError` only to stop the search.
    claims: Callable[[Path], bool]
    read: Callable[[Path, ColumnOptions], StepTables]  # a `DataError` where it cannot be read
    keep: Keep | None = None
    # What `keep` writes no new file of, in words; empty where it writes one.
    unkept: Callable[[Path, ColumnOptions], str] = lambda *_: ""
    suffixes: tuple[str, ...] = ()  # extensions of its files; those that `write` writes have the first
    # Writes demonstrations to a path, and true values (M,) for each by name, which `read` ignores.
    write: Callable[[Path, Demonstrations, Mapping[str, Array]], None] | None = None
    # A `DataError` where `keep` cannot write the data to the output, before any work; extensions are compared before.
    check_output: Callable[[Path, Path], object] = lambda *_: None
    # What beside the demonstrations does not agree with them; with True, in videos too.
    find_defects: Callable[[Path, bool], list[Defect]] | None = None
    # Writes a copy to a new folder that says more of each demonstration: by the name of a column, values by id as text.
    annotate: Callable[[Path, Path, Mapping[str, Mapping[str, object]]], None] | None = None
    shots: Callable[[Path], Sequence[Shot]] | None = None  # where in video files each is seen; these need not be there
