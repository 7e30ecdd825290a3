"""A Parquet file by plain calls of pyarrow: its bytes, its rows, and what its footer says they take in memory.

pyarrow believes a file, and a damaged one may end the process: local files are first read in a process of its own, see
`rpil.formats.imported`. Files of other computers are not, whose clients do not go on after a fork.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import AbstractContextManager
from pathlib import PurePath
from typing import TYPE_CHECKING

from rpil.data.errors import DataError
from rpil.data.held import held
from rpil.data.memory import BYTES_PER_NUMBER, check_memory
from rpil.formats.table import kind_of_type

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq
    from pyarrow import fs

_LONGEST_VALUE = 2**20
"""Numbers in a list, and bytes in a text, of a step."""


def input_file(filesystem: fs.FileSystem, path: PurePath | str) -> AbstractContextManager[pa.NativeFile]:
    """The bytes of a file; see `rpil.data.held`."""
    return held(str(path), lambda: filesystem.open_input_file(str(path)), filesystem.type_name)


def read_table(
    path: PurePath | str, columns: Sequence[str] | None = None, filesystem: fs.FileSystem | None = None
) -> pa.Table:
    """Those of the columns that are there, by default all; a `DataError` where they do not fit in memory.

    Errors of pyarrow are left as they are.
    """
    import pyarrow.parquet as pq
    from pyarrow import fs

    name = PurePath(path).name
    with input_file(filesystem or fs.LocalFileSystem(), path) as stream, pq.ParquetFile(stream) as file:
        names = file.schema_arrow.names
        chosen = names if columns is None else [column for column in columns if column in names]
        where = name if columns is None or len(columns) > 1 else f"{name}, column {columns[0]!r}"
        check_memory(sum(bytes_of_groups(file, chosen)), where)
        table = file.read(chosen, use_threads=False)
    check_table(table, name)
    return table


def check_table(table: pa.Table, name: str) -> None:
    """A `DataError` where a text or a list of a file called `name` is longer than any of a step."""
    import pyarrow as pa
    import pyarrow.compute as pc

    table.validate(full=True)  # text from a damaged file need not be Unicode, and lists may end beyond their numbers
    for field, column in zip(table.schema, table.columns, strict=True):
        kind, measure = kind_of_type(field.type), pc.list_value_length
        if kind == "text":
            is_encoded, measure = pa.types.is_dictionary(field.type), pc.binary_length
            column = pa.chunked_array([c.dictionary for c in column.chunks], pa.string()) if is_encoded else column
        n = pc.max(measure(column)).as_py() if kind in ("text", "list") else 0
        if (n or 0) > _LONGEST_VALUE:
            what = "bytes in a text" if kind == "text" else "numbers in a list"
            fault = f"column {field.name!r} has {n:,} {what}, and {_LONGEST_VALUE:,} is the most"
            raise DataError(f"{name}: {fault}; write shorter ones, or drop the column.")


def bytes_of_groups(file: pq.ParquetFile, columns: Collection[str]) -> list[int]:
    """The bytes that `columns` take in memory in each row group, by the footer."""
    names, leaves = set(file.schema_arrow.names), range(len(file.schema))
    chosen = [k for k in leaves if _column_of(file.schema.column(k).path, names) in columns]
    groups = map(file.metadata.row_group, range(file.num_row_groups))
    chunks = ([group.column(k) for k in chosen] for group in groups)
    return [sum(max(BYTES_PER_NUMBER * c.num_values, c.total_uncompressed_size) for c in own) for own in chunks]


def _column_of(path: str, names: Collection[str]) -> str:
    """The column, one of the `names`, which may have dots, of a part of it at a path such as ``x.list.element``."""
    while path not in names and path:
        path = path.rpartition(".")[0]
    return path
