"""CSV: the flat table as text; numbers come back exactly, as float64 and int64."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.data.formats import table as flat
from rpil.data.memory import check_memory
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

_MEMORY_PER_BYTE = 4  # of a file whose numbers have four characters


def read(path: Path) -> Demonstrations:
    """Read the columns that hold data, and no others."""
    import pyarrow as pa
    from pyarrow import csv

    def read_table(types: Mapping[str, pa.DataType]) -> pa.Table:
        return csv.read_csv(path, convert_options=csv.ConvertOptions(include_columns=columns.all, column_types=types))

    check_memory(_MEMORY_PER_BYTE * path.stat().st_size, path.name)
    try:
        with csv.open_csv(path) as reader:
            names = reader.schema.names
        columns = flat.find_columns(names, path.name)
        # By default the reader takes the ids 01 and 1 for the same number, and -0 for the integer 0.
        texts = [columns.episode, *(columns.actions if columns.one_action else ())]
        types = dict.fromkeys(columns.all, pa.float64()) | dict.fromkeys(texts, pa.string())
        try:
            table = read_table(types)
        except pa.ArrowInvalid:  # there is text: read it as such, so that the message can say where
            table = read_table({name: types[name] for name in texts})
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())[:100].replace(". ", ", ").rstrip(".")
        raise DataError(
            f"{path.name}: not a CSV file, or a damaged or truncated one ({reason}); write it again."
        ) from error
    for name in texts:
        column = _parse(table[name], floats=name != columns.episode)
        table = table.set_column(table.column_names.index(name), name, column)
    return flat.to_demonstrations(table, columns, path.name)


def write(path: Path, demonstrations: Demonstrations, truth: Mapping[str, Array]) -> None:
    """Write the flat table as text."""
    write_tables(path, iter([flat.from_demonstrations(demonstrations, truth)]))


def write_tables(path: Path, tables: Iterator[pa.Table]) -> None:
    """Write tables of one schema one below the other; one of them is in memory at a time."""
    import pyarrow as pa
    from pyarrow import csv

    first = next(tables)
    # The shortest text of a float32 would be read as another float64.
    schema = pa.schema([f.with_type(pa.float64()) if pa.types.is_float32(f.type) else f for f in first.schema])
    with replacing(path) as temporary, csv.CSVWriter(temporary, schema) as writer:
        for table in chain([first], tables):
            writer.write_table(table.cast(schema))


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
