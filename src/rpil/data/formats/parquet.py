"""Parquet: the flat table with its types kept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.data.formats import table as flat
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa


def read(path: Path) -> Demonstrations:
    """Read the columns that hold data, and no others."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            columns = flat.find_columns(file.schema_arrow.names, path.name)
            table = file.read(columns=columns.all)
        table.validate(full=True)  # text from a damaged file need not be Unicode
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path.name}: not a Parquet file, or a damaged or truncated one; write it again.") from error
    return flat.to_demonstrations(table, columns, path.name)


def write(path: Path, demonstrations: Demonstrations, truth: Mapping[str, Array]) -> None:
    """Write the flat table, with its types."""
    write_tables(path, iter([flat.from_demonstrations(demonstrations, truth)]))


def write_tables(path: Path, tables: Iterator[pa.Table]) -> None:
    """Write tables of one schema one below the other; one of them is in memory at a time."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    first = next(tables)
    # Floating-point values rarely repeat: a dictionary of them only costs time and space.
    dictionary = [field.name for field in first.schema if not pa.types.is_floating(field.type)]
    with (
        replacing(path) as temporary,
        pq.ParquetWriter(temporary, first.schema, use_dictionary=dictionary, write_page_checksum=True) as writer,
    ):
        for table in chain([first], tables):
            writer.write_table(table)
