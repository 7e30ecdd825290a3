"""CSV: the flat table as text; numbers come back exactly, as float64 and int64."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.data.formats import table as flat


def read(path: Path) -> Demonstrations:
    """Read the columns that hold data, and no others."""
    import pyarrow as pa
    from pyarrow import csv

    def table_of(types: dict[str, Any]) -> Any:
        options = csv.ConvertOptions(include_columns=columns.all, column_types=types)
        return csv.read_csv(path, convert_options=options)

    try:
        with csv.open_csv(path) as reader:
            names = reader.schema.names
        columns = flat.find_columns(names, path.name)
        # Left to guess, the reader would take the ids 01 and 1 for the same number, and -0 for the integer 0.
        texts = [columns.episode, *(columns.actions if columns.one_action else ())]
        types = dict.fromkeys(columns.all, pa.float64()) | dict.fromkeys(texts, pa.string())
        try:
            table = table_of(types)
        except pa.ArrowInvalid:  # let it guess after all: there is text, and the message should say where
            table = table_of({name: types[name] for name in texts})
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())[:100].replace(". ", ", ").rstrip(".")
        raise DataError(
            f"{path.name}: not a CSV file, or a damaged or truncated one ({reason}); write it again."
        ) from error
    for name in texts:
        column = _settle(table[name], floats=name != columns.episode)
        table = table.set_column(table.column_names.index(name), name, column)
    return flat.to_demonstrations(table, columns, path.name)


def write(path: Path, demonstrations: Demonstrations, truth: Mapping[str, NDArray[Any]]) -> None:
    """Write the flat table as text."""
    write_tables(path, iter([flat.from_demonstrations(demonstrations, truth)]))


def write_tables(path: Path, tables: Iterator[Any]) -> None:
    """Write any ``pyarrow.Table`` of one schema, numbers and text, one below the other; one is in memory at a time."""
    import pyarrow as pa
    from pyarrow import csv

    first = next(tables)
    # The shortest text of a float32 is another number when read as float64; that of its float64 is not.
    wide = [field.with_type(pa.float64()) if pa.types.is_float32(field.type) else field for field in first.schema]
    schema = pa.schema(wide)
    with replacing(path) as temporary, csv.CSVWriter(temporary, schema) as writer:
        for table in chain([first], tables):
            writer.write_table(table.cast(schema))


def _settle(column: Any, floats: bool) -> Any:
    """Text to integers if each is written the one usual way, else to floats if allowed, else unchanged; "" to null."""
    import pyarrow as pa
    import pyarrow.compute as pc

    column = pc.if_else(pc.equal(column, ""), None, column)
    try:
        numbers = column.cast(pa.int64())
        return numbers if numbers.cast(pa.string()).equals(column) else column
    except pa.ArrowInvalid:
        pass
    if floats:
        try:
            return column.cast(pa.float64())
        except pa.ArrowInvalid:
            pass
    return column
