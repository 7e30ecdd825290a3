"""CSV: the flat table as text; numbers come back exactly, as float64 and int64."""

from __future__ import annotations

import csv
import gzip
import io
import itertools
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, TypeVar, cast

from rpil.data.cells import from_cell, to_cell, to_cells
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.data.guard import guarded
from rpil.data.memory import MIB
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions, Columns, check_names
from rpil.formats.dialect import TEXT_SUFFIXES, Dialect, find_dialect, text_bytes, without_suffix
from rpil.formats.format import Format, keep_one_file
from rpil.formats.places import in_two_files
from rpil.formats.rows import Rows, TableRows
from rpil.formats.spool import spool
from rpil.formats.step_tables import StepTables
from rpil.formats.store import copied_rows
from rpil.formats.table_facts import Origin
from rpil.formats.text_types import exact, exact_type, texts_of, written_as
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa
    from pyarrow import csv as pacsv

_Result = TypeVar("_Result")

FILE = "file"  # the column of the file's name, where nothing else names the demonstration
_FAULT = "not a CSV file, or a damaged or truncated one", "write it again"
_BLOCK_BYTES = MIB
_MAX_BLOCK_BYTES = (1 << 31) - 1
_BLOCKS_ON_DISK = 32  # together, by which the types of columns are told where the table is never in memory


@dataclass(frozen=True)
class Text:
    """A text table; its name in messages, which may hold the folder."""

    path: Path
    name: str
    dialect: Dialect


def claims(path: Path) -> bool:
    """Whether `path` is a file whose name is that of a text table, which may be compressed."""
    return path.is_file() and path.name.lower().endswith(TEXT_SUFFIXES)


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read the columns that hold data, and the numbers of the rows."""
    dialect = find_dialect(path, options.on_disk)
    columns = find_text_columns(path, dialect, options)
    note = () if dialect.encoding in ("utf-8", "utf-16") else (f"Text is not UTF-8: read as {dialect.encoding}.",)
    return _read([Text(path, path.name, dialect)], columns, path.name, dialect.words, note)


def read_folder(paths: Sequence[Path], options: ColumnOptions, source: str) -> StepTables:
    """Read files with the same columns; where no column names the demonstration, each file is one."""
    files = [
        Text(path, name, find_dialect(path, options.on_disk))
        for path, name in zip(paths, names_in_folder(paths), strict=True)
    ]
    first = files[0]
    for file in files:
        if set(file.dialect.names) != set(first.dialect.names):
            raise DataError(
                f"{file.name}: its columns are not those of {first.name}; give all files the same ones, or take it out."
            )
    columns = find_text_columns(first.path, first.dialect, options, FILE)
    return _read(files, columns, source, f"{first.dialect.words}, {len(paths):,} files", ())


def _read(files: Sequence[Text], columns: Columns, source: str, format_name: str, notes: tuple[str, ...]) -> StepTables:
    """The recording in text tables, one below the other.

    Column types are inferred from all rows, so the files are read twice; for data on disk, by a temporary file.
    """
    seen: dict[str, str] = {}
    for file in files if columns.episode == FILE else ():
        if seen.setdefault(_id_of(file), file.name) != file.name:
            raise in_two_files(_id_of(file), seen[_id_of(file)], file.name, source)
    decimal = files[0].dialect.decimal
    found = [(file, _read_table(file, columns)) for file in files]

    def tables() -> Iterator[pa.Table]:
        for file, rows in found:
            there = rows.tables(0, len(rows), _names_in(file, columns))
            yield from (_named(table, file, columns) for _, table, _ in there)

    kinds: dict[str, set[str]] = {}
    for table in tables():
        for name, column in texts_of(table, columns, decimal).items():
            kinds.setdefault(name, set()).update(written_as(column, name in columns.actions))
    types = {name: exact_type(found) for name, found in kinds.items()}
    sizes = {file.name: len(rows) for file, rows in found}
    return StepTables(
        (exact(table, columns, decimal, types) for table in tables()),
        columns,
        Origin(source, format_name, notes=notes),
        sizes,
    )


def _names_in(file: Text, columns: Columns) -> list[str]:
    """The columns to read that a file has; on disk without outcomes, because its first block tells their types."""
    own = set(file.dialect.names)
    return [name for name in (*columns.all, *(() if file.dialect.on_disk else columns.outcomes)) if name in own]


def _id_of(file: Text) -> str:
    """The demonstration that a file is, where no column names it."""
    return without_suffix(file.name)


def _named(table: pa.Table, file: Text, columns: Columns) -> pa.Table:
    """The table with a column of the file's name where this names the demonstration."""
    if columns.episode != FILE:
        return table
    return table.append_column(FILE, [[_id_of(file)] * len(table)])


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

    check_names(dialect.names, path.name)

    def head(parsing: dict[str, object]) -> pa.Table:
        convert = csv.ConvertOptions(decimal_point=dialect.decimal)
        with text_bytes(path) as text, csv.open_csv(text, convert_options=convert, **parsing) as reader:
            return pa.Table.from_batches(itertools.islice(reader, 1), reader.schema)

    with guarded(path.name, *_FAULT):
        first = _parsed(path, dialect, head)
        kinds = flat.kinds_of(first.slice(0, flat.HEAD_ROWS))
    return find_columns(dialect.names, kinds, path.name, options, default_id, first)


def _read_table(file: Text, columns: Columns) -> Rows:
    """The columns to read, ids and single actions as text."""
    import pyarrow as pa
    from pyarrow import csv

    # By default the reader takes the ids 01 and 1 for the same number, and -0 for the integer 0.
    named = columns.episode, columns.operator, columns.task, columns.session
    as_text = {*named, *(columns.actions if columns.one_action else ())} - {None}
    names = _names_in(file, columns)
    texts = {name: pa.string() for name in names if name in as_text}
    floats = {name: pa.float64() for name in (*columns.observations, *columns.actions) if name not in as_text}

    def converted(types: Mapping[str, pa.DataType], parsing: dict[str, object]) -> Rows:
        chosen = {"include_columns": names, "column_types": types}
        convert = csv.ConvertOptions(decimal_point=file.dialect.decimal, strings_can_be_null=False, **chosen)
        return (_copy if file.dialect.on_disk else _whole)(file.path, convert_options=convert, **parsing)

    with guarded(file.path.name, *_FAULT):
        # Where there is text, or true and false, they are read as such, so that the message can say where.
        for types in (texts | floats, texts):
            try:
                return _parsed(file.path, file.dialect, partial(converted, types))
            except pa.ArrowInvalid as error:
                if "CSV conversion error" not in str(error):
                    raise
        said = "a column holds values of another type further on; read it into memory with <option>"
        raise DataError(f"{file.path.name}: {said}.", "no_stream")


def _whole(path: Path, **options: object) -> Rows:
    from pyarrow import csv

    with text_bytes(path) as text:
        return TableRows(csv.read_csv(text, **options), path.name)


def _copy(path: Path, **options: object) -> Rows:
    """A copy of the columns, of which a block at a time is in memory: the first tells the types of other columns."""
    import pyarrow as pa
    from pyarrow import csv

    with text_bytes(path) as text, csv.open_csv(text, **options) as reader:
        return copied_rows(spool((pa.Table.from_batches([batch]) for batch in reader), path.name), {})


def _parsed(path: Path, dialect: Dialect, read_table: Callable[[dict[str, object]], _Result]) -> _Result:
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
    block = (_BLOCKS_ON_DISK if dialect.on_disk else 1) * _BLOCK_BYTES
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
                with suppress(pa.ArrowInvalid), text_bytes(path) as text:
                    csv.read_csv(text, reading, parse)
                row = ragged[0]
                raise DataError(
                    f"{path.name}, row {row.number - dialect.skip_rows}: {row.actual_columns} values for "
                    f"{row.expected_columns} columns in {row.text[:40]!r}, which is damaged or truncated; "
                    "write it again."
                ) from error
            if "block" not in str(error) or block == _MAX_BLOCK_BYTES:
                raise
            block = min(block * 32, _MAX_BLOCK_BYTES)


def keep_text(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> set[str]:
    """Write the lines of the demonstrations `ids` of a text table, and its comments; return the ids found."""
    dialect = find_dialect(path)
    column = dialect.names.index(find_text_columns(path, dialect, options).episode)
    encoding, found = dialect.encoding, set()
    opener = gzip.open if path.suffix.lower() == ".gz" else open
    with (
        text_bytes(path) as stream,
        io.TextIOWrapper(stream, encoding=encoding, newline="") as source,
        cast(IO[str], opener(output, "wt", encoding=encoding, newline="")) as target,
    ):
        target.writelines(itertools.islice(source, dialect.skip_rows))
        for lines, values in _rows(source, dialect.separator):
            is_comment = lines.lstrip().startswith("#") and len(values) != len(dialect.names)
            is_row = bool(values) and not is_comment
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
    name="CSV",
    claims=claims,
    read=read,
    keep=keep_one_file(keep_text),
    suffixes=TEXT_SUFFIXES,
    write=write,
    reads_in_place=lambda _: True,
)
