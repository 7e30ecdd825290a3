"""CSV: the flat table as text, UTF-8; numbers come back exactly, as float64 and int64."""

from __future__ import annotations

import codecs
import csv
import itertools
import os
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from rpil.data.errors import DamagedError, DataError, guarded
from rpil.data.files import replacing
from rpil.data.memory import MIB, check_memory
from rpil.data.text import counted, each_text, from_cell, quoted, to_cell
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import FILE, ColumnOptions, Columns, check_names
from rpil.formats.format import Format, StepTables, called
from rpil.formats.scan import without_damaged
from rpil.formats.steps import ArrowFile
from rpil.formats.table import other_columns

TEXT_SUFFIXES = (".csv", ".tsv", ".txt")
MEMORY_PER_BYTE = 4  # of a file whose numbers have four characters
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
_HEAD_LINES = 200
_CHUNK = 16 * MIB
_COMMENT = re.compile(r"\s*#|sep=.$", re.IGNORECASE)  # Excel writes the separator into a line of its own
_QUOTED = re.compile(r'"(?:[^"]|"")*"')
_WRITTEN_NUMBER = re.compile(r"\s*[+-]?(?:\d+|\d*([.,])\d+|\d+[.,])(?:[eE][+-]?\d+)?\s*")
"""A number, and the decimal sign that digits follow."""

_REFUSED_NUMBER = re.compile(rf"column #(\d+): .*'({_WRITTEN_NUMBER.pattern})'")  # in an error of Arrow
_FAULT = "not a CSV file in UTF-8, or a damaged or truncated one", "write it again, as UTF-8"
_HEAD_BYTES, _BLOCK_BYTES = MIB, 32 * MIB  # by which kinds of columns are told, and which are parsed at a time


@dataclass(frozen=True)
class TextTable:
    """A text table and how to read it."""

    path: Path
    names: tuple[str, ...]  # of the columns, without spaces around them
    skip_rows: int  # lines up to the first row of values
    separator: str
    decimal: str

    def check(self) -> None:
        """A `DataError` that names the first damaged line, where there is one."""
        if damaged := [f"line {number:,}: {fault}" for number, _, _, fault in text_rows(self) if fault]:
            more = f", the first of {len(damaged):,} damaged lines" if len(damaged) > 1 else ""
            raise DamagedError(f"{self.path.name}, {damaged[0]}{more}; correct it, or write the file again.")


def text_rows(file: TextTable) -> Iterator[tuple[int, str, list[str], str]]:
    """All lines of a text table: each is one row, so that a quotation ends in its line. Its number, from 1; the line
    with its end; its values, of which a comment, an empty line and the header have none; and what is wrong with it."""
    with guarded(file.path.name, *_FAULT), file.path.open(encoding="utf-8", newline="") as source:
        for number, line in enumerate(source, 1):
            if number <= file.skip_rows or not line.strip():
                yield number, line, [], ""
                continue
            values, fault = list[str](), ""
            try:
                values = next(csv.reader([line], delimiter=file.separator, strict=True))
            except csv.Error:
                fault = f"a quotation begins and does not end in {line.strip()[-40:]!r}; a line is a row"
            if not fault and len(values) != len(file.names) and line.lstrip().startswith("#"):
                values = []
            elif not fault and len(values) != len(file.names):
                fault = f"{len(values)} values for {len(file.names)} columns in {line.strip()[:40]!r}"
            elif not fault and tuple(map(str.strip, values)) == file.names:
                fault = "it repeats the names of the columns, as where files were joined"
            yield number, line, values, fault


def find_dialect(path: Path, options: ColumnOptions) -> TextTable:
    """The dialect of a file; a `DataError` where it is no text, has no names of columns, or would not fit in memory."""
    check_memory(0 if options.on_disk else MEMORY_PER_BYTE * path.stat().st_size, path.name, options.memory)
    with guarded(path.name, *_FAULT), path.open("rb") as stream:
        lines = codecs.getincrementaldecoder("utf-8-sig")().decode(stream.read(_CHUNK)).splitlines()[:_HEAD_LINES]
    if (is_empty := not any(map(str.strip, lines))) or "\0" in lines[0]:
        fault = ("the file is empty", "write it again, or read its folder with --skip-bad") if is_empty else _FAULT
        raise DamagedError(f"{path.name}: {'; '.join(fault)}.")
    start = next((k for k, line in enumerate(lines) if line.strip() and not _COMMENT.match(line)), len(lines) - 1)
    header = _QUOTED.sub("", lines[start])
    if header.count('"') % 2:
        said = f"a quotation begins and does not end in {lines[start].strip()[-40:]!r}, its names of columns"
        raise DamagedError(f"{path.name}, line {start + 1}: {said}; correct it.")
    separator = max(_SEPARATORS, key=header.count)
    names = [name.strip() for name in next(csv.reader([lines[start]], delimiter=separator, skipinitialspace=True))]
    if len(names) > 1 and 2 * sum(bool(_WRITTEN_NUMBER.fullmatch(name)) for name in names) > len(names):
        said = f"the first row holds numbers, not names; put the names of its {len(names)} columns above it"
        raise DataError(f"{path.name}: {said}, or give a frame in Python, as pandas.read_csv(FILE, names=[...]).")
    names = [name or (f"Unnamed: {k}" if k else "") for k, name in enumerate(names)]
    cells = (cell.strip('"') for line in lines[start + 1 :] if separator != "," for cell in line.split(separator))
    signs = {found[1] for cell in cells if (found := _WRITTEN_NUMBER.fullmatch(cell))}
    return TextTable(path, tuple(names), start + 1, separator, "," if "," in signs and "." not in signs else ".")


def read_files(paths: Sequence[Path], options: ColumnOptions, source: str, default_id: str | None = None) -> StepTables:
    """Read files with the same columns; each is a demonstration where none is its id, if the `default_id` is `FILE`."""
    folder = os.path.commonpath([path.absolute().parent for path in paths])
    named = {path.absolute().relative_to(folder).as_posix(): path for path in paths}

    def dialect(name: str) -> TextTable:
        file = find_dialect(named[name], options)
        if options.skip_bad and len(named) > 1:  # to skip it before its first rows are taken
            file.check()
        return file

    files, damaged = without_damaged(named, dialect, options.skip_bad)
    (first_name, first), *_ = files.items()
    for name, file in files.items():
        if set(file.names) != set(first.names):
            raise other_columns(name, first_name, file.names, first.names)
    columns = replace(find_text_columns(first, options, default_id), id_written=True)
    words = ["CSV", *[f"separated by {_SEPARATORS[first.separator]}"] * (first.separator != ",")]
    words += ["decimal commas"] * (first.decimal == ",") + [counted(len(files), "file")] * (default_id is not None)
    tables, sizes = _rows_of(files, columns, source)
    return StepTables(tables, columns, source, ", ".join(words), sizes, skipped=tuple(damaged))


def write_tables(path: Path, tables: Iterator[pa.Table]) -> None:
    """Write tables of one schema one below the other, text so that it is no formula; one is in memory at a time."""
    first = next(tables)
    # The shortest text of a float32 would be read as another float64.
    schema = pa.schema([f.with_type(pa.float64()) if pa.types.is_float32(f.type) else f for f in first.schema])
    safe = pa.schema([field.with_name(str(to_cell(field.name))) for field in schema])
    with replacing(path) as temporary, pa.csv.CSVWriter(temporary, safe) as writer:
        for table in itertools.chain([first], tables):
            cells = [each_text(to_cell, column) for column in table.cast(schema).columns]
            writer.write_table(pa.table(cells, schema=safe))


def find_text_columns(file: TextTable, options: ColumnOptions, default_id: str | None = None) -> Columns:
    """The columns by the first block of the file, which tells their types."""
    if len(file.names) == 1:
        said = f"it has one column, {file.names[0][:40]!r}; write commas, semicolons or tabs between columns"
        raise DataError(f"{file.path.name}: {said}.")
    check_names(file.names, file.path.name)
    with _parsing(file), file.path.open("rb") as text:
        content = text.read(_CHUNK)
        content = content[: content.find(b"\n", _HEAD_BYTES) + 1] or content  # whole lines
        first = pa.csv.read_csv(pa.BufferReader(content), *_options(file, len(content) + 1))  # one block
    if not len(first) and default_id is None:
        raise DataError(f"{file.path.name}: it has no rows; write one for each step below the names of its columns.")
    # Decimal commas beside points count as numbers here, so that reading refuses them, and leaves no column out.
    signs = "." if file.separator == "," else ",", ","
    kinds, by_comma = (flat.kinds_of(first.slice(0, flat.HEAD_ROWS), sign) for sign in signs)
    wrong = [name for name, kind in kinds.items() if kind != by_comma[name]]
    fault = "column {} has decimal commas; write points, semicolons between columns, or --action-kind discrete."
    try:
        columns = find_columns(kinds, file.path.name, options, default_id)
    except DataError as error:
        if not wrong:
            raise
        raise DataError(f"{error.in_shell[:-1]}; {fault.format(quoted(wrong[:1]))}") from error
    if acted := [name for name in wrong if name in columns.actions and options.action_kind != "discrete"]:
        raise DataError(f"{file.path.name}: {fault.format(quoted(acted[:1]))}")
    return columns


class _OtherTypeError(DataError):
    """A value is not of the type of its column."""


@contextmanager
def _parsing(file: TextTable) -> Iterator[None]:
    """Name the first damaged line in errors of parsing."""
    with guarded(file.path.name, *_FAULT):
        try:
            yield
        except pa.ArrowInvalid as error:
            if "CSV conversion error" in str(error) and "UTF8" not in str(error):
                found = _REFUSED_NUMBER.search(str(error))
                if found and file.separator != "," and found[3] not in (None, file.decimal):
                    name, value = file.names[int(found[1])], found[2].strip()
                    said = f"column {name!r} holds {value}, and other numbers have a decimal {file.decimal!r}"
                    raise DataError(f"{file.path.name}: {said}; write one sign, or --exclude the column.") from error
                said = "a column holds values of another type further on; write them alike, or allow more with --memory"
                raise _OtherTypeError(f"{file.path.name}: {said}.") from error
            file.check()
            raise


def _options(file: TextTable, block_size: int, **conversion: object) -> tuple[object, ...]:
    """The options for reading, parsing and converting the bytes of a file."""
    comments = {"invalid_row_handler": lambda row: "skip" if row.text.lstrip().startswith("#") else "error"}
    lines = pa.csv.ReadOptions(column_names=file.names, skip_rows=file.skip_rows, block_size=block_size)
    cells = pa.csv.ParseOptions(delimiter=file.separator, **comments)
    return lines, cells, pa.csv.ConvertOptions(decimal_point=file.decimal, **conversion)


def _rows_of(
    files: Mapping[str, TextTable], columns: Columns, source: str
) -> tuple[list[pa.Table] | ArrowFile, dict[str, int]]:
    """The rows of the files, in the first types that fit all values, and how many each has: observations are floats, or
    what they seem; a single action is a whole number, a float or text."""
    named = columns.episode, columns.operator, columns.task, columns.session
    texts = dict.fromkeys((name for name in named if name), pa.string())  # else 01 and 1 would be one id
    floats = dict.fromkeys((*columns.observations, *columns.actions), pa.float64())
    kinds = (pa.int64(), pa.float64(), pa.string()) if columns.one_action else (None,)
    own = [dict.fromkeys(columns.actions, kind) if kind else {} for kind in kinds]
    faults = list[DataError]()
    for types in ({**others, **action, **texts} for others in (floats, {}) for action in own):
        sizes = dict.fromkeys(files, 0)
        tables = _tables(files, columns, types, sizes)
        try:
            if not columns.options.on_disk:
                return [*tables], sizes
            if len(files) > 1:  # which get the types that fit the first rows of all
                each = (_tables({name: file}, columns, types, {name: 0}) for name, file in files.items())
                firsts = [table.slice(0, 0) for found in each for table in itertools.islice(found, 1)]
                schema = flat.end_to_end(firsts, source).schema
                tables = (table.cast(schema) for table in tables)
            return ArrowFile.of(tables, source), sizes
        except _OtherTypeError as error:
            faults.append(error)
    for file in files.values():
        file.check()
    raise faults[-1]


def _tables(
    files: Mapping[str, TextTable], columns: Columns, types: Mapping[str, pa.DataType], sizes: dict[str, int]
) -> Iterator[pa.Table]:
    """The columns to read, of these types, and how many rows each file has."""
    for name, file in files.items():
        names = [one for one in columns.all if one in file.names]
        options = _options(file, _BLOCK_BYTES, include_columns=names, strings_can_be_null=False, column_types=types)
        with _parsing(file), file.path.open("rb") as text:
            if columns.options.on_disk:
                found = (pa.Table.from_batches([batch]) for batch in pa.csv.open_csv(text, *options))
            else:
                found = (table for table in [pa.csv.read_csv(text, *options)])
            for table in found:
                sizes[name] += len(table)
                yield _whole(table, name, file, columns)
            # Where the numbers of lines and rows differ, a quotation may have joined lines.
            with file.path.open("rb") as lines:
                if sum(1 for _ in lines) != file.skip_rows + sizes[name]:
                    file.check()


def _whole(table: pa.Table, name: str, file: TextTable, columns: Columns) -> pa.Table:
    """The rows of a file, with its `name` if that is the id; "" is null and texts are stripped, but in observations."""
    if columns.episode == FILE:
        table = table.append_column(FILE, [[Path(name).with_suffix("").as_posix()] * len(table)])
    for k, field in enumerate(table.schema):
        if flat.kind_of_type(field.type) == "text" and field.name not in columns.observations:
            texts = each_text(lambda text: from_cell(text.strip()) or None, table[k].cast(pa.string()))
            table = table.set_column(k, field.name, texts)
    ids = table[columns.episode] if columns.episode in table.column_names else ()
    if len(ids) and pc.any(pc.equal(ids, columns.episode)).as_py():
        file.check()  # as it may be a second head
    return table


def keep_text(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> None:
    """Write the lines of the demonstrations `ids` of a text table, and its comments."""
    file = find_dialect(path, options)
    column = file.names.index(find_text_columns(file, options, None).episode)
    with output.open("w", encoding="utf-8", newline="") as target:
        for _, line, values, fault in text_rows(file):
            if fault:
                file.check()
            if not values or from_cell(values[column].strip()) in ids:
                target.write(line)


FORMAT = Format(
    name="CSV",
    claims=called(*TEXT_SUFFIXES),
    read=lambda path, options: read_files([path], options, path.name),
    keep=keep_text,
    suffixes=TEXT_SUFFIXES,
    write=lambda path, *data: write_tables(path, iter([flat.from_demonstrations(*data)])),
)
