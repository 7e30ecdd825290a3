"""CSV: the flat table as text; numbers come back exactly, as float64 and int64."""

from __future__ import annotations

import gzip
import itertools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, cast

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from rpil.data.cells import each_text, from_cell, to_cell
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.data.guard import guarded
from rpil.data.memory import MIB
from rpil.data.text import counted
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions, Columns, check_names
from rpil.formats.dialect import TEXT_SUFFIXES, TextTable, find_dialect, text_bytes, text_rows, without_suffix
from rpil.formats.format import Format, StepTables, called, keep_one_file
from rpil.formats.named_files import in_text
from rpil.formats.places import in_two_files
from rpil.formats.scan import parts_in_words, without_damaged
from rpil.formats.steps import ArrowFile, Steps
from rpil.formats.table import other_columns

FILE = "file"  # the column of the file's name, where nothing else names the demonstration
_FAULT = "not a CSV file, or a damaged or truncated one", "write it again"
_BLOCK_BYTES = MIB
_MAX_BLOCK_BYTES = (1 << 31) - 1
_BLOCKS_ON_DISK = 32  # together, by which the types of columns are told where the table is never in memory


def read_files(paths: Sequence[Path], options: ColumnOptions, source: str, default_id: str | None = None) -> StepTables:
    """Read files with the same columns, one below the other; each is a demonstration where no column is its id, and the
    `default_id` is `FILE`."""
    folder = os.path.commonpath([path.absolute().parent for path in paths])
    named = {path.absolute().relative_to(folder).as_posix(): path for path in paths}
    files, damaged = without_damaged(named, lambda name: find_dialect(named[name], options), options.skip_bad)
    skipped = (parts_in_words(file.skipped, "line", [name]) for name, file in files.items() if file.skipped)
    (first_name, first), *_ = files.items()
    for name, file in files.items():
        if set(file.names) != set(first.names):
            raise other_columns(name, first_name, file.names, first.names)
    columns = replace(find_text_columns(first, options, default_id), id_written=True)
    seen: dict[str, str] = {}
    for name in files if columns.episode == FILE else ():
        other = seen.setdefault(without_suffix(name), name)
        if other != name:
            raise in_two_files(without_suffix(name), other, name, source)
    words = first.words if default_id is None else f"{first.words}, {counted(len(files), 'file')}"
    is_western = any(file.encoding != "utf-8" for file in files.values())
    notes = ("Text is not UTF-8: read as cp1252.",) if is_western else ()
    found = _rows_of(files, columns)
    tables = found[first_name] if options.on_disk else found.values()
    if options.on_disk and len(found) > 1:  # with types that fit all of them
        schema = pa.unify_schemas([rows.schema for rows in found.values()], promote_options="permissive")
        steps = (one for name, rows in found.items() for _, one, _ in Steps(rows, name).tables(schema.names))
        tables = (table.cast(schema) for table in steps)
    sizes = {name: len(rows) for name, rows in found.items()}
    return StepTables(tables, columns, source, words, sizes, notes=notes, skipped=(*damaged, *skipped))


def write_tables(path: Path, tables: Iterator[pa.Table]) -> None:
    """Write tables of one schema one below the other, text so that it is no formula; one is in memory at a time."""
    first = next(tables)
    # The shortest text of a float32 would be read as another float64.
    schema = pa.schema([f.with_type(pa.float64()) if pa.types.is_float32(f.type) else f for f in first.schema])
    safe = pa.schema([field.with_name(str(to_cell(field.name))) for field in schema])
    with replacing(path) as temporary, pa.csv.CSVWriter(temporary, safe) as writer:
        for table in itertools.chain([first], tables):
            writer.write_table(
                pa.table([each_text(to_cell, column) for column in table.cast(schema).columns], schema=safe)
            )


def find_text_columns(file: TextTable, options: ColumnOptions, default_id: str | None = None) -> Columns:
    """The columns by the first block of the file, which tells their types."""
    if len(file.names) == 1:
        said = f"it has one column, {file.names[0][:40]!r}; write commas, semicolons or tabs between columns"
        raise DataError(f"{file.path.name}: {said}.")
    check_names(file.names, file.path.name)

    def head(text: pa.NativeFile, *options: object) -> pa.Table:
        with pa.csv.open_csv(text, *options) as reader:
            return pa.Table.from_batches(itertools.islice(reader, 1), reader.schema)

    with guarded(file.path.name, *_FAULT):
        first = _parsed(file, head)
        kinds = flat.kinds_of(first.slice(0, flat.HEAD_ROWS))
        if not len(first) and default_id is None:
            said = "it has no rows; write one for each step below the names of its columns"
            raise DataError(f"{file.path.name}: {said}.")
    return find_columns(file.names, kinds, file.path.name, options, default_id)


class _OtherTypeError(DataError):
    """A value is not of the type of its column."""


def _rows_of(files: Mapping[str, TextTable], columns: Columns) -> dict[str, Any]:
    """The rows of the files, in the first types that fit all values: observations are floats, or what they seem; a
    single action is a whole number, a float or text."""
    named = columns.episode, columns.operator, columns.task, columns.session
    texts = dict.fromkeys((name for name in named if name), pa.string())  # else 01 and 1 would be one id
    floats = dict.fromkeys((*columns.observations, *columns.actions), pa.float64())
    kinds = (pa.int64(), pa.float64(), pa.string()) if columns.one_action else (None,)
    own = [dict.fromkeys(columns.actions, kind) if kind else {} for kind in kinds]
    fault = None
    for types in ({**others, **action, **texts} for others in (floats, {}) for action in own):
        try:
            return {name: _read_table(name, file, columns, types) for name, file in files.items()}
        except _OtherTypeError as error:
            fault = error
    for file in files.values():
        file.check()
    assert fault is not None
    raise fault


def _read_table(name: str, file: TextTable, columns: Columns, types: Mapping[str, pa.DataType]) -> Any:
    """The columns to read; a copy of them on disk."""

    def whole(table: pa.Table) -> pa.Table:
        if columns.episode == FILE:
            table = table.append_column(FILE, [[without_suffix(name)] * len(table)])
        for k, field in enumerate(table.schema):  # spaces around texts go, and "" is null, but for observations
            if flat.kind_of_type(field.type) == "text" and field.name not in columns.observations:
                texts = each_text(lambda text: from_cell(text.strip()) or None, table[k].cast(pa.string()))
                table = table.set_column(k, field.name, texts)
        ids = table[columns.episode] if columns.episode in table.column_names else ()
        if len(ids) and pc.any(pc.equal(ids, columns.episode)).as_py():
            file.check()  # as it may be a second head
        return table

    def rows(text: pa.NativeFile, *options: object) -> Any:
        if not file.on_disk:
            return whole(pa.csv.read_csv(text, *options))
        with pa.csv.open_csv(text, *options) as reader:
            return ArrowFile.of((whole(pa.Table.from_batches([batch])) for batch in reader), file.path.name)

    names = [one for one in columns.all if one in file.names]
    with guarded(file.path.name, *_FAULT):
        found = _parsed(file, rows, include_columns=names, strings_can_be_null=False, column_types=types)
        if file.n_lines not in (0, file.skip_rows + len(found)):  # in which no row can be lost
            file.check()
        return found


def _parsed(file: TextTable, take: Callable[..., Any], **conversion: object) -> Any:
    """The result of `take` for the bytes and the options for reading, parsing and converting them.

    They are read again in larger blocks where a field does not fit in.
    """

    def on_invalid(row: pa.csv.InvalidRow) -> str:
        return "skip" if row.text.lstrip().startswith("#") else "error"

    parsing = pa.csv.ParseOptions(delimiter=file.separator, invalid_row_handler=on_invalid)
    reading = pa.csv.ReadOptions(column_names=file.names, skip_rows=file.skip_rows)
    reading.encoding = "utf8" if file.encoding == "utf-8" or file.skipped else file.encoding
    reading.block_size = (_BLOCKS_ON_DISK if file.on_disk else 1) * _BLOCK_BYTES
    while True:
        converting = pa.csv.ConvertOptions(decimal_point=file.decimal, **conversion)
        try:
            with file.without_skipped() if file.skipped else text_bytes(file.path) as text:
                return take(text, reading, parsing, converting)
        except pa.ArrowInvalid as error:
            if "CSV conversion error" in str(error):
                said = "a column holds values of another type further on; write them alike, or allow more with <option>"
                raise _OtherTypeError(f"{file.path.name}: {said}.", "memory") from error
            if "block" in str(error) and reading.block_size < _MAX_BLOCK_BYTES:
                reading.block_size = min(reading.block_size * 32, _MAX_BLOCK_BYTES)
            else:
                file.check()
                raise


def keep_text(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> set[str]:
    """Write the lines of the demonstrations `ids` of a text table, and its comments; return the ids found."""
    file = find_dialect(path, options)
    column, found = file.names.index(find_text_columns(file, options, None).episode), set[str]()
    opener = gzip.open if path.suffix.lower() == ".gz" else open
    with cast(IO[str], opener(output, "wt", encoding=file.encoding, newline="")) as target:
        for _, line, values, fault in text_rows(file):
            if fault:
                file.check()
                continue
            demonstration = from_cell(values[column].strip()) if values else ""
            found.add(demonstration)
            if not values or demonstration in ids:
                target.write(line)
    return found & ids


FORMAT = Format(
    name="CSV",
    claims=called(*TEXT_SUFFIXES),
    read=lambda path, options: read_files([path], options, path.name),
    keep=keep_one_file(keep_text),
    suffixes=TEXT_SUFFIXES,
    write=lambda path, *data: write_tables(path, iter([flat.from_demonstrations(*data)])),
    find_defects=lambda path, _: [] if path.name.lower().endswith(".gz") else [*in_text(path)],
)
