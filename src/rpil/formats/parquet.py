"""Parquet: the flat table with its types kept."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence, Set
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path, PurePosixPath

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import fs

from rpil.data.errors import DamagedError, DataError
from rpil.data.files import replacing
from rpil.data.memory import check_memory
from rpil.data.names import EPISODE, is_data
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions, Columns, Kind, check_names
from rpil.formats.description import parts_in_words, without_damaged
from rpil.formats.format import Format, StepTables, called, keep_one_file
from rpil.formats.guesses import GUESSED_ROWS
from rpil.formats.meta_folder import MetaFolder, read_metadata
from rpil.formats.parquet_file import bytes_of_groups, check_sizes, check_table, read_table
from rpil.formats.rows import ParquetRows, end_to_end, opened, other_columns, rows_of
from rpil.formats.table import BATCH_ROWS
from rpil.formats.table_facts import Metadata, Origin, file_names
from rpil.formats.times import with_facts

_HEAD_COLUMNS = 2000  # whose first values are looked at
_NESTED_ROWS = 1000  # read at a time where there are images

Change = Callable[["pa.Table"], "pa.Table"]


def read_files(filesystem: fs.FileSystem, paths: Sequence[str], options: ColumnOptions, source: str) -> StepTables:
    """Read files with the same columns, whose rows go into memory or stay where they are, as the options say."""
    paths, skipped = readable(filesystem, paths, source) if options.skip_bad else (paths, ())
    try:
        rows, columns, metadata = _open_rows(filesystem, paths, options)
    except DamagedError:
        readable(filesystem, paths, source, skips=False)
        raise
    name = f"LeRobot {metadata.version}" if metadata.version else "Parquet"
    origin = Origin(source, name if len(paths) == 1 else f"{name}, {len(paths):,} files", metadata, skipped=skipped)
    tables: Iterator[pa.Table] = (
        table for _, table, _ in rows.tables(0, len(rows), [*columns.all, *columns.may_be_outcomes])
    )
    if not options.on_disk:
        check_memory(rows.n_bytes, source, options.memory)
    if named := [name for name in columns.made if name in metadata.facts]:
        tables = with_facts(tables, columns.episode, {name: metadata.facts[name] for name in named})
        columns = replace(columns, made=tuple(name for name in columns.made if name not in named))
    return StepTables(tables, columns, origin, rows.sizes, rows if options.on_disk and not named else None)


def _open_rows(
    filesystem: fs.FileSystem, paths: Sequence[str], options: ColumnOptions
) -> tuple[ParquetRows, Columns, Metadata]:
    """The rows of the files `paths`, their columns, and what they say of themselves.

    A `DataError` where the columns of the files differ.
    """
    parts, columns, metadata, first = list[ParquetRows](), None, Metadata(), PurePosixPath(paths[0]).name
    for path in paths:
        name = PurePosixPath(path).name
        with opened(filesystem, path) as file:
            if path == paths[0]:  # so that damaged data are named before damaged metadata
                metadata = read_metadata(filesystem, paths)
            columns = columns or columns_of_file(file, name, options, metadata.facts)
            names, known = set(file.schema_arrow.names), {*columns.all, *columns.ignored}
            if not names.issuperset(columns.all) or any(is_data(other) for other in names - known):
                raise other_columns(name, first, names, known)
            read = {*columns.all, *columns.may_be_outcomes}
            n_bytes = sum(check_sizes(file, read, filesystem, path))
            parts.append(rows_of(file, filesystem, path, read, n_bytes))
    if columns is None or not any(map(len, parts)):
        raise DataError(f"{paths[0]}: there are no demonstrations; give at least one with at least one step.")
    return end_to_end(parts, file_names(paths)), columns, metadata


def columns_of_file(file: pq.ParquetFile, name: str, options: ColumnOptions, facts: Collection[str] = ()) -> Columns:
    """The columns of an open file, by their names, types and first values; a `DataError` where these are too large.

    Those of the `facts` that the user names are among them.
    """
    schema = file.schema_arrow
    check_names(schema.names, name)
    kinds = {field.name: flat.kind_of_type(field.type) for field in schema} if file.metadata.num_rows else {}
    # Of images no value is read, and of very many columns the types are enough.
    plain = [column for column, kind in kinds.items() if kind in ("number", "text")][:_HEAD_COLUMNS]
    bytes_of_groups(file, plain, name)
    n_rows = GUESSED_ROWS if options.guess else flat.HEAD_ROWS
    batch = next(file.iter_batches(n_rows, columns=plain, use_threads=False), None)
    head = None if batch is None else pa.Table.from_batches([batch])
    if head is not None:
        check_table(head, name)
        kinds |= flat.kinds_of(head.slice(0, flat.HEAD_ROWS))
    outcomes = (name.removeprefix("-") for name in options.outcomes)
    named = {options.operator, options.session, *outcomes} - {*schema.names}
    made: dict[str, Kind] = {fact: "text" for fact in facts if fact in named}
    return find_columns(schema.names, kinds, name, options, head=head, made=made)


def readable(
    filesystem: fs.FileSystem, paths: Sequence[str], source: str, skips: object = True
) -> tuple[list[str], tuple[str, ...]]:
    """The Parquet files that are not damaged, by all of their rows, and words for the others; unless these are skipped,
    a `DataError` on them, by footers alone."""

    def read(path: str) -> None:
        with opened(filesystem, path) as file:
            for batch in file.iter_batches(flat.HEAD_ROWS, use_threads=False) if skips else ():
                batch.validate(full=True)

    found, damaged = without_damaged(paths, read)
    names, lost, left = _episodes(filesystem, damaged, found)
    words = parts_in_words(lost, "episode", names)
    if damaged and not skips:
        said = f"damaged, as where a recording is cut off: {words}; copy again, or read and keep"
        others = parts_in_words(left, "episode", []) or "the others"
        raise DataError(f"{source}: {said} {others} with <option>.", "skip_bad")
    return [*found], (words,) if words else ()


def _episodes(
    filesystem: fs.FileSystem, damaged: Sequence[str], others: Collection[str]
) -> tuple[list[str], list[int], list[int]]:
    """The names of damaged files; the episodes that ``meta`` lists and others have not, and those that they have."""
    data = next((folder for path in damaged for folder in PurePosixPath(path).parents if folder.name == "data"), None)
    if data is None:
        return [PurePosixPath(path).name for path in damaged], [], []
    there, listed = set[int](), set[int]()
    with suppress(DataError):  # of damaged metadata, which their reader names
        listed |= {int(m) for m in MetaFolder(filesystem, data.parent).lengths}
    for path in others if listed else ():
        there |= {*read_table(path, [EPISODE[0]], filesystem)[EPISODE[0]].to_pylist()}
    names = [str(PurePosixPath(path).relative_to(data.parent)) for path in damaged]
    return names, sorted(listed - there), sorted(there)


def write_tables(path: Path, tables: Iterator[pa.Table]) -> None:
    """Write tables of one schema one below the other; one of them is in memory at a time."""
    first = next(tables)
    # Floating-point values rarely repeat: a dictionary of them only costs time and space.
    dictionary = [field.name for field in first.schema if not pa.types.is_floating(field.type)]
    with (
        replacing(path) as temporary,
        pq.ParquetWriter(temporary, first.schema, use_dictionary=dictionary, write_page_checksum=True) as writer,
    ):
        for table in chain([first], tables):
            writer.write_table(table)


def keep_rows(
    path: Path, output: Path, ids: Set[str], options: ColumnOptions, change: Change = lambda table: table
) -> set[str]:
    """Write the rows of the demonstrations `ids` of a Parquet file, after a `change`; return the ids found."""
    found: set[str] = set()
    tables = _kept_tables(path, ids, options, found)
    schema = next(tables).schema
    with pq.ParquetWriter(output, schema) as writer:  # whose errors must not be taken for those of the file
        for table in tables:
            writer.write_table(change(table).cast(schema))
    return found


def _kept_tables(path: Path, ids: Set[str], options: ColumnOptions, found: set[str]) -> Iterator[pa.Table]:
    """An empty table of a Parquet file's columns, and then its rows of the demonstrations `ids`, which `found` gets."""
    filesystem = fs.LocalFileSystem()
    with opened(filesystem, str(path)) as file:
        schema = file.schema.to_arrow_schema()
        nested = any(flat.kind_of_type(field.type) == "nested" for field in schema)
        column = columns_of_file(file, path.name, options).episode
        check_memory(max(check_sizes(file, schema.names, filesystem, path), default=0), path.name, options.memory)
        yield schema.empty_table()
        names, owners = flat.id_codes(file.read([column], use_threads=False), column, lambda _: path.name)
        wanted = {k: str(name) for k, name in enumerate(names) if str(name) in ids}
        found |= {*wanted.values()}
        rows = np.flatnonzero(np.isin(owners, [*wanted]))
        first = 0
        for batch in file.iter_batches(_NESTED_ROWS if nested else BATCH_ROWS, use_threads=False):
            a, b = np.searchsorted(rows, [first, first + len(batch)])
            table = pa.Table.from_batches([batch]).take(rows[a:b] - first)
            first += len(batch)
            if a < b:
                yield table


FORMAT = Format(
    name="Parquet",
    claims=called(".parquet"),
    read=lambda path, options: read_files(fs.LocalFileSystem(), [str(path.absolute())], options, path.name),
    keep=keep_one_file(keep_rows),
    suffixes=(".parquet",),
    write=lambda path, *data: write_tables(path, iter([flat.from_demonstrations(*data)])),
)
