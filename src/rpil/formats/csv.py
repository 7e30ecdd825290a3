"""CSV: the flat table as text; numbers come back exactly, as float64 and int64."""

from __future__ import annotations

import csv
import gzip
import itertools
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, cast

from rpil.data.cells import from_cell, from_cells, to_cell, to_cells
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.data.guard import guarded
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions, Columns, check_unique
from rpil.formats.dialect import TEXT_SUFFIXES, Dialect, find_dialect, without_suffix
from rpil.formats.format import Format, keep_one_file
from rpil.formats.recording import Recording, from_table
from rpil.formats.table import refuse_id_in_two_files
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa
    from pyarrow import csv as pacsv

_Reader = Callable[[dict[str, object]], "pa.Table"]

FILE = "file"  # the column of the file's name, where nothing else names the demonstration
_FAULT = "not a CSV file, or a damaged or truncated one", "write it again"
_BLOCK_BYTES = 1 << 20
_MAX_BLOCK_BYTES = (1 << 31) - 1


def claims(path: Path) -> bool:
    """Whether `path` is a file whose name is that of a text table, which may be compressed."""
    return path.is_file() and path.name.lower().endswith(TEXT_SUFFIXES)


def read(path: Path, options: ColumnOptions) -> Recording:
    """Read the columns that hold data, and the numbers of the rows."""
    dialect = find_dialect(path)
    columns = find_text_columns(path, dialect, options)
    table = _exact(_read_table(path, dialect, columns), columns, dialect.decimal)
    note = () if dialect.encoding in ("utf-8", "utf-16") else (f"Text is not UTF-8: read as {dialect.encoding}.",)
    return from_table(table, columns, path.name, dialect.words, notes=note, files={path.name: len(table)})


def read_folder(paths: Sequence[Path], options: ColumnOptions, source: str) -> Recording:
    """Read files with the same columns; where no column names the demonstration, each file is one."""
    first = find_dialect(paths[0])
    columns = find_text_columns(paths[0], first, options, FILE)
    names = names_in_folder(paths)
    tables = []
    for path, name in zip(paths, names, strict=True):
        dialect = find_dialect(path)
        if set(dialect.names) != set(first.names):
            raise DataError(f"{name}: its columns are not those of {names[0]}; give all files the same ones.")
        table = _read_table(path, dialect, columns)
        if columns.episode == FILE:
            table = table.append_column(FILE, [[without_suffix(name)] * len(table)])
        tables.append(table)
    refuse_id_in_two_files([table[columns.episode] for table in tables], names, source, columns.episode != FILE)
    import pyarrow as pa

    table = _exact(pa.concat_tables(tables, promote_options="permissive"), columns, first.decimal)
    files = dict(zip(names, map(len, tables), strict=True))
    return from_table(table, columns, source, f"{first.words}, {len(paths):,} files", files=files)


def write(path: Path, demonstrations: Demonstrations, truth: Mapping[str, Array]) -> None:
    """Write the flat table as text."""
    write_tables(path, iter([flat.from_demonstrations(demonstrations, truth)]))


def write_tables(path: Path, tables: Iterator[pa.Table]) -> None:
    """Write tables of one schema one below the other, text so that it is no formula; one is in memory at a time."""
    import pyarrow as pa
    from pyarrow import csv

    first = next(tables)
    # The shortest text of a float32 would be read as another float64.
    schema = pa.schema([f.with_type(pa.float64()) if pa.types.is_float32(f.type) else f for f in first.schema])
    safe = pa.schema([field.with_name(str(to_cell(field.name))) for field in schema])
    with replacing(path) as temporary, csv.CSVWriter(temporary, safe) as writer:
        for table in itertools.chain([first], tables):
            writer.write_table(pa.table([to_cells(column) for column in table.cast(schema).columns], schema=safe))


def names_in_folder(paths: Sequence[Path]) -> list[str]:
    """The names of files, with the folders below the one that holds all of them."""
    folder = os.path.commonpath([path.absolute().parent for path in paths])
    return [path.absolute().relative_to(folder).as_posix() for path in paths]


def find_text_columns(path: Path, dialect: Dialect, options: ColumnOptions, default_id: str | None = None) -> Columns:
    """The columns by the first block of the file, which tells their types."""
    import pyarrow as pa
    from pyarrow import csv

    check_unique(dialect.names, path.name)

    def head(parsing: dict[str, object]) -> pa.Table:
        convert = csv.ConvertOptions(decimal_point=dialect.decimal)
        with csv.open_csv(path, convert_options=convert, **parsing) as reader:
            return pa.Table.from_batches(itertools.islice(reader, 1), reader.schema)

    with guarded(path.name, *_FAULT):
        kinds = flat.kinds_of(_parsed(path, dialect, head).slice(0, flat.HEAD_ROWS))
    return find_columns(dialect.names, kinds, path.name, options, default_id)


def _read_table(path: Path, dialect: Dialect, columns: Columns) -> pa.Table:
    """The columns to read, ids and single actions as text."""
    import pyarrow as pa
    from pyarrow import csv

    # By default the reader takes the ids 01 and 1 for the same number, and -0 for the integer 0.
    named = columns.episode, columns.operator, columns.task, columns.session
    texts = {*named, *(columns.actions if columns.one_action else ())} - {None}
    names = [name for name in columns.all if name in dialect.names]
    types = {name: pa.string() for name in names if name in texts}
    floats = {name: pa.float64() for name in (*columns.observations, *columns.actions) if name not in texts}

    def read_table(parsing: dict[str, object], column_types: Mapping[str, pa.DataType] = types | floats) -> pa.Table:
        convert = csv.ConvertOptions(
            decimal_point=dialect.decimal, include_columns=names, column_types=column_types, strings_can_be_null=False
        )
        return csv.read_csv(path, convert_options=convert, **parsing)

    with guarded(path.name, *_FAULT):
        try:
            return _parsed(path, dialect, read_table)
        except pa.ArrowInvalid as error:
            if "CSV conversion error" not in str(error):
                raise
        # There is text, or true and false: read it as such, so that the message can say where.
        return _parsed(path, dialect, lambda parsing: read_table(parsing, types))


def _parsed(path: Path, dialect: Dialect, read_table: _Reader) -> pa.Table:
    """What `read_table` gives with the options for parsing, the block larger where a field does not fit in."""
    import pyarrow as pa
    from pyarrow import csv

    ragged: list[pacsv.InvalidRow] = []

    def on_invalid(row: pacsv.InvalidRow) -> str:
        if row.text.lstrip().startswith("#"):
            return "skip"
        ragged.append(row)
        return "error"

    parse = csv.ParseOptions(delimiter=dialect.separator, newlines_in_values=True, invalid_row_handler=on_invalid)
    block = _BLOCK_BYTES
    while True:
        reading = csv.ReadOptions(
            column_names=dialect.names,
            skip_rows=dialect.skip_rows,
            encoding={"utf-8": "utf8"}.get(dialect.encoding, dialect.encoding),
            block_size=block,
        )
        try:
            return read_table({"read_options": reading, "parse_options": parse})
        except pa.ArrowInvalid as error:
            if ragged:
                ragged.clear()
                reading.use_threads = False  # only then rows are numbered
                with suppress(pa.ArrowInvalid):
                    csv.read_csv(path, reading, parse)
                row = ragged[0]
                raise DataError(
                    f"{path.name}, row {row.number - dialect.skip_rows}: {row.actual_columns} values for "
                    f"{row.expected_columns} columns in {row.text[:40]!r}, which is damaged or truncated; "
                    "write it again."
                ) from error
            if "block" not in str(error) or block == _MAX_BLOCK_BYTES:
                raise
            block = min(block * 32, _MAX_BLOCK_BYTES)


def _exact(table: pa.Table, columns: Columns, decimal: str) -> pa.Table:
    """Ids, single actions, operators and tasks as the numbers that they are, if that loses nothing."""
    import pyarrow as pa
    import pyarrow.compute as pc

    for name in table.column_names:
        if name not in columns.observations and pa.types.is_string(table[name].type):
            is_action = name in columns.actions
            column = from_cells(pc.utf8_trim_whitespace(table[name]))
            if is_action and decimal == ",":
                column = pc.replace_substring(column, ",", ".")
            table = table.set_column(table.column_names.index(name), name, _parse(column, is_action))
    return table


def _parse(column: pa.ChunkedArray, floats: bool) -> pa.ChunkedArray:
    """Text as integers if that loses nothing (01 does), else as `floats` if allowed, else as it is; "" as null.

    Whole numbers of over 64 bits stay text, because several would become the same float.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    column = pc.if_else(pc.equal(column, ""), None, column)
    with suppress(pa.ArrowInvalid):
        numbers = column.cast(pa.int64())
        return numbers if numbers.cast(pa.string()).equals(column) else column
    if floats and not pc.any(pc.match_substring_regex(column, r"^[+-]?\d{19,}$")).as_py():
        with suppress(pa.ArrowInvalid):
            return column.cast(pa.float64())
    return column


def keep_text(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> set[str]:
    """Write the lines of the demonstrations `ids` of a text table, and its comments; return the ids found."""
    dialect = find_dialect(path)
    column = dialect.names.index(find_text_columns(path, dialect, options).episode)
    encoding, found = dialect.encoding, set()
    with _open(path, "rt", encoding) as source, _open(output, "wt", encoding) as target:
        target.writelines(itertools.islice(source, dialect.skip_rows))
        for lines, values in _rows(source, dialect.separator):
            is_row = bool(values) and not lines.lstrip().startswith("#")
            name = from_cell(values[column].strip()) if is_row else ""
            if not is_row or name in ids:
                target.write(lines)
                found.add(name)
    return found & ids


def keep_text_or_file(path: Path, output: Path, ids: Set[str], options: ColumnOptions, name: str) -> set[str]:
    """The same for a file of a folder: it is the demonstration `name` where no column names the demonstration."""
    if find_text_columns(path, find_dialect(path), options, FILE).episode != FILE:
        return keep_text(path, output, ids, options)
    if name in ids:
        shutil.copyfile(path, output)
    return {name} & ids


def _open(path: Path, mode: str, encoding: str) -> IO[str]:
    opener = gzip.open if path.suffix.lower() == ".gz" else open
    return cast(IO[str], opener(path, mode, encoding=encoding, newline=""))


def _rows(lines: Iterable[str], separator: str) -> Iterator[tuple[str, list[str]]]:
    """The text of each row, which may have several lines, and its values."""
    taken: list[str] = []
    for values in csv.reader(_tee(lines, taken), delimiter=separator):
        yield "".join(taken), values
        taken.clear()


def _tee(lines: Iterable[str], taken: list[str]) -> Iterator[str]:
    for line in lines:
        taken.append(line)
        yield line


FORMAT = Format(
    name="CSV", claims=claims, read=read, keep=keep_one_file(keep_text), suffixes=TEXT_SUFFIXES, write=write
)
