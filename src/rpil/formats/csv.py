"""CSV: the flat table as text; numbers come back exactly, as float64 and int64."""

from __future__ import annotations

import csv
import gzip
import itertools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, TypeVar, cast

from rpil.data.cells import each_text, from_cell, to_cell
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.data.guard import guarded
from rpil.data.memory import MIB
from rpil.data.text import counted
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions, Columns, check_names
from rpil.formats.damage import parts_in_words, without_damaged
from rpil.formats.dialect import TEXT_SUFFIXES, TextTable, find_dialect, text_bytes, text_rows, without_suffix
from rpil.formats.format import Format, StepTables, called, keep_one_file
from rpil.formats.places import in_two_files
from rpil.formats.rows import Rows, TableRows
from rpil.formats.spool import spool
from rpil.formats.store import copied_rows, other_columns
from rpil.formats.table_facts import Origin
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

_Result = TypeVar("_Result")

Texts = tuple["pa.ChunkedArray", "pa.Array"]
"""The different texts of a column, and the number of that of each row."""

FILE = "file"  # the column of the file's name, where nothing else names the demonstration
_FAULT = "not a CSV file, or a damaged or truncated one", "write it again"
_BLOCK_BYTES = MIB
_MAX_BLOCK_BYTES = (1 << 31) - 1
_BLOCKS_ON_DISK = 32  # together, by which the types of columns are told where the table is never in memory


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read the columns that hold data, and the numbers of the rows."""
    file = find_dialect(path, options)
    note = () if file.encoding in ("utf-8", "utf-16") else (f"Text is not UTF-8: read as {file.encoding}.",)
    skipped = (parts_in_words(file.skipped, "line", [path.name]),) if file.skipped else ()
    origin = Origin(path.name, file.words, notes=note, skipped=skipped)
    return _read({path.name: file}, find_text_columns(file, options), origin)


def read_folder(paths: Sequence[Path], options: ColumnOptions, source: str) -> StepTables:
    """Read files with the same columns; where no column names the demonstration, each file is one."""
    files, skipped = readable(names_in_folder(paths), options)
    (first_name, first), *_ = files.items()
    for name, file in files.items():
        if set(file.names) != set(first.names):
            raise other_columns(name, first_name, file.names, first.names)
    columns = find_text_columns(first, options, FILE)
    seen: dict[str, str] = {}
    for name in files if columns.episode == FILE else ():
        other = seen.setdefault(without_suffix(name), name)
        if other != name:
            raise in_two_files(without_suffix(name), other, name, source)
    return _read(files, columns, Origin(source, f"{first.words}, {counted(len(files), 'file')}", skipped=skipped))


def readable(paths: Mapping[str, Path], options: ColumnOptions) -> tuple[dict[str, TextTable], tuple[str, ...]]:
    """The text tables at the paths, by their names, and which lines and files are skipped."""
    files, damaged = without_damaged(paths, lambda name: find_dialect(paths[name], options), options.skip_bad)
    lines = [parts_in_words(file.skipped, "line", [name]) for name, file in files.items() if file.skipped]
    return files, (*damaged, *lines)


def _read(files: Mapping[str, TextTable], columns: Columns, origin: Origin) -> StepTables:
    """The recording in text tables, one below the other, by their names.

    All texts of a column decide its type; for data on disk they are looked at twice, in a temporary file.
    """
    any_file = next(iter(files.values()))
    found = {name: _read_table(file, columns) for name, file in files.items()}

    def tables() -> Iterator[tuple[pa.Table, dict[str, Texts]]]:
        for name, rows in found.items():
            for _, table, _ in rows.tables(0, len(rows), _names_in(files[name], columns)):
                if columns.episode == FILE:
                    table = table.append_column(FILE, [[without_suffix(name)] * len(table)])
                yield table, _texts_of(table, columns, any_file.decimal)

    whole = None if any_file.on_disk else [*tables()]
    written: dict[str, set[str]] = {}
    for _, texts in whole or tables():
        for name, (different, _) in texts.items():
            written.setdefault(name, set()).update(_written_as(different, name in columns.actions))
    sizes = {name: len(rows) for name, rows in found.items()}
    exact = (_exact(table, texts, written) for table, texts in whole or tables())
    return StepTables(exact, columns, origin, sizes)


def _texts_of(table: pa.Table, columns: Columns, decimal: str) -> dict[str, Texts]:
    """The columns of text but observations, without spaces around each text; "" as null."""
    import pyarrow as pa
    import pyarrow.compute as pc

    found: dict[str, Texts] = {}
    for name in {*table.column_names} - {*columns.observations}:
        if flat.kind_of_type(table[name].type) == "text":
            encoded = table[name].dictionary_encode().unify_dictionaries().combine_chunks()
            texts = each_text(from_cell, pa.chunked_array([pc.utf8_trim_whitespace(encoded.dictionary)]))
            if name in columns.actions and decimal == ",":
                texts = pc.replace_substring(texts, ",", ".")
            found[name] = pc.if_else(pc.equal(texts, ""), None, texts), encoded.indices
    return found


def _written_as(texts: pa.ChunkedArray, floats: bool) -> set[str]:
    """How texts are written, all together: as whole numbers that come back ("number"), that do not, as 01 and -0 do
    ("digits"), as decimals if `floats` ("decimal"), or otherwise ("text"); and whether any has more digits than a float
    ("long")."""
    import pyarrow as pa
    import pyarrow.compute as pc

    long = {"long"} if pc.any(pc.match_substring_regex(texts, r"^[+-]?\d{19,}$")).as_py() else set()
    with suppress(pa.ArrowInvalid):
        return long | {"number" if texts.cast(pa.int64()).cast(pa.string()).equals(texts) else "digits"}
    with suppress(pa.ArrowInvalid):
        if floats:
            texts.cast(pa.float64())
            return long | {"decimal"}
    return {"text"}


def _exact(table: pa.Table, texts: Mapping[str, Texts], written: Mapping[str, set[str]]) -> pa.Table:
    """Columns of text as integers if that loses nothing, else as floats where there are decimals, else as text.

    `written` is how all of their texts are. Whole numbers of over 64 bits stay text, because several would become the
    same float.
    """
    import pyarrow as pa

    for name, (different, rows) in texts.items():
        kinds, kind = written[name], pa.int64()
        if kinds & {"text", "decimal", "digits"}:
            is_float = "decimal" in kinds and not kinds & {"text", "long"}
            kind = pa.float64() if is_float else pa.string()
        table = table.set_column(table.column_names.index(name), name, different.cast(kind).take(rows))
    return table


def _names_in(file: TextTable, columns: Columns) -> list[str]:
    """The columns to read that a file has; on disk without outcomes, because its first block tells their types."""
    own = {*file.names}
    return [name for name in (*columns.all, *(() if file.on_disk else columns.outcomes)) if name in own]


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
            writer.write_table(
                pa.table([each_text(to_cell, column) for column in table.cast(schema).columns], schema=safe)
            )


def names_in_folder(paths: Sequence[Path]) -> dict[str, Path]:
    """Files by their names, with the folders below the one that holds all of them."""
    folder = os.path.commonpath([path.absolute().parent for path in paths])
    return {path.absolute().relative_to(folder).as_posix(): path for path in paths}


def find_text_columns(file: TextTable, options: ColumnOptions, default_id: str | None = None) -> Columns:
    """The columns by the first block of the file, which tells their types."""
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import csv

    if len(file.names) == 1:
        said = f"it has one column, {file.names[0][:40]!r}; write commas, semicolons or tabs between columns"
        raise DataError(f"{file.path.name}: {said}.")
    check_names(file.names, file.path.name)

    def head(text: pa.NativeFile, *options: object) -> pa.Table:
        with csv.open_csv(text, *options) as reader:
            return pa.Table.from_batches(itertools.islice(reader, 1), reader.schema)

    with guarded(file.path.name, *_FAULT):
        first = _parsed(file, head, {})
        kinds = flat.kinds_of(first.slice(0, flat.HEAD_ROWS))
        floats = [one.name for one in first.schema if options.guess and pa.types.is_floating(one.type)]
        # Ids of more digits than numbers have would be one id.
        if long := [name for name in floats if pc.any(pc.greater(pc.abs(first[name]), 2.0**63)).as_py()]:
            first = _parsed(file, head, {"column_types": dict.fromkeys(long, pa.string())})
    return find_columns(file.names, kinds, file.path.name, options, default_id, first)


def _read_table(file: TextTable, columns: Columns) -> Rows:
    """The columns to read, ids and single actions as text; a copy of them on disk."""
    import pyarrow as pa
    from pyarrow import csv

    def rows(text: pa.NativeFile, *options: object) -> Rows:
        if not file.on_disk:
            return TableRows(csv.read_csv(text, *options), file.path.name)
        with csv.open_csv(text, *options) as reader:
            return copied_rows(spool((pa.Table.from_batches([batch]) for batch in reader), file.path.name), {})

    # By default the reader takes the ids 01 and 1 for the same number, and -0 for the integer 0.
    named = columns.episode, columns.operator, columns.task, columns.session
    as_text = {*named, *(columns.actions if columns.one_action else ())}
    names = _names_in(file, columns)
    texts = {name: pa.string() for name in names if name in as_text}
    floats = {name: pa.float64() for name in (*columns.observations, *columns.actions) if name not in as_text}
    common = {"include_columns": names, "strings_can_be_null": False}
    with guarded(file.path.name, *_FAULT):
        try:
            # Where there is text, or true and false, they are read as such, so that the message can say where.
            found = _parsed(file, rows, *(common | {"column_types": types} for types in (texts | floats, texts)))
            if file.n_lines not in (0, file.skip_rows + len(found)):  # in which no row can be lost
                file.check()
            return found
        except pa.ArrowInvalid as error:
            if "CSV conversion error" not in str(error):
                raise
        said = "a column holds values of another type further on; read it into memory with <option>"
        raise DataError(f"{file.path.name}: {said}.", "no_stream")


def _parsed(file: TextTable, take: Callable[..., _Result], *conversions: dict[str, object]) -> _Result:
    """What `take` makes of the bytes and the options for reading, parsing and converting them.

    They are read again with the next of the `conversions` where values are of another type, and in larger blocks where
    a field does not fit in.
    """
    import pyarrow as pa
    from pyarrow import csv

    def on_invalid(row: csv.InvalidRow) -> str:
        return "skip" if row.text.lstrip().startswith("#") else "error"

    parsing = csv.ParseOptions(delimiter=file.separator, newlines_in_values=True, invalid_row_handler=on_invalid)
    reading = csv.ReadOptions(column_names=file.names, skip_rows=file.skip_rows)
    reading.encoding = "utf8" if file.encoding == "utf-8" or file.skipped else file.encoding
    reading.block_size = (_BLOCKS_ON_DISK if file.on_disk else 1) * _BLOCK_BYTES
    while True:
        converting = csv.ConvertOptions(decimal_point=file.decimal, **conversions[0])
        try:
            with file.without_skipped() if file.skipped else text_bytes(file.path) as text:
                return take(text, reading, parsing, converting)
        except pa.ArrowInvalid as error:
            if "CSV conversion error" in str(error) and conversions[1:]:
                conversions = conversions[1:]
            elif "block" in str(error) and reading.block_size < _MAX_BLOCK_BYTES:
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
        for _, _, lines, values, fault in text_rows(file):
            if fault:
                file.check()
            demonstration = from_cell(values[column].strip()) if values else ""
            found.add(demonstration)
            if not fault and (not values or demonstration in ids):
                target.writelines(lines)
    return found & ids


FORMAT = Format(
    name="CSV",
    claims=called(*TEXT_SUFFIXES),
    read=read,
    keep=keep_one_file(keep_text),
    suffixes=TEXT_SUFFIXES,
    write=write,
    tables=lambda _: "text",
)
