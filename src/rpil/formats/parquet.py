"""Parquet: the flat table with its types kept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.data.files import replacing
from rpil.data.memory import check_memory
from rpil.formats import table as flat
from rpil.formats.columns import ColumnOptions
from rpil.formats.lerobot import format_name
from rpil.formats.recording import Recording, from_table
from rpil.formats.store import open_rows
from rpil.formats.table import refuse_id_in_two_files
from rpil.formats.table_facts import file_names
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa
    from pyarrow import fs


def read(path: Path, options: ColumnOptions) -> Recording:
    """Read the columns that hold data, and the numbers of the rows."""
    from pyarrow import fs

    return read_files(fs.LocalFileSystem(), [str(path.absolute())], options, path.name)


def read_files(filesystem: fs.FileSystem, paths: Sequence[str], options: ColumnOptions, source: str) -> Recording:
    """Read files with the same columns into memory."""
    import pyarrow as pa

    rows, columns, _, metadata = open_rows(filesystem, paths, options)
    check_memory(rows.n_bytes, source)
    tables: dict[str, list[pa.Table]] = {name: [] for name in file_names(paths)}
    for row, table, _ in rows.tables(0, rows.runs[-1][1], columns.all):
        table.validate(full=True)  # text from a damaged file need not be Unicode
        tables[rows.files(np.array([row]))[0]].append(table)
    whole = {name: pa.concat_tables(found, promote_options="permissive") for name, found in tables.items() if found}
    refuse_id_in_two_files([table[columns.episode] for table in whole.values()], list(whole), source)
    table = pa.concat_tables(whole.values(), promote_options="permissive")
    files = {name: len(found) for name, found in whole.items()}
    return from_table(table, columns, source, format_name(metadata, len(paths)), metadata, files=files)


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
