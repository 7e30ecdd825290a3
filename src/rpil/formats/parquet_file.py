"""A Parquet file by plain calls of pyarrow: its bytes, its rows, and what its footer says they take in memory.

pyarrow believes a file, so that what its footer declares is compared with its rows, and pages of lists with the footer.
"""

from __future__ import annotations

import io
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from rpil.data.errors import DataError, guarded
from rpil.data.files import StrPath, refuse_pointer
from rpil.data.memory import BYTES_PER_NUMBER, MIB, check_free, check_memory
from rpil.formats.table import BATCH_ROWS, kind_of_type

_LONGEST_VALUE = 2**20
"""Numbers in a list, and bytes in a text, of a step."""

_LARGEST_PAGE = 64 * MIB
"""Bytes of a column that may be decoded at once, however few its rows are."""

_BUFFER_BYTES = 262_144  # of a column, read at a time: a row group need not fit in memory


@contextmanager
def opened(path: StrPath) -> Iterator[pq.ParquetFile]:
    """The open file, whose checksums are compared as it is read; a `DataError` where it is no Parquet file."""
    try:
        # Neither mapped into memory, where mapped pages stay and count, nor fetched by whole row groups.
        options = {"buffer_size": _BUFFER_BYTES, "pre_buffer": False, "page_checksum_verification": True}
        with pa.OSFile(str(path)) as stream, pq.ParquetFile(stream, **options) as file:
            # A text that repeats stays in memory once.
            texts = [field.name for field in file.schema_arrow if pa.types.is_string(field.type)]
            if texts:
                file = pq.ParquetFile(stream, metadata=file.metadata, read_dictionary=texts, **options)
            yield file
    except Exception:
        with guarded(Path(path).name, "not a Parquet file, or a damaged or truncated one", "write it again"):
            with pa.OSFile(str(path)) as stream:
                refuse_pointer(stream.read_at(100, 0), Path(path).name)
            raise


def read_table(path: StrPath, columns: Sequence[str] | None = None) -> pa.Table:
    """Read the columns that are there, by default all; a `DataError` where they do not fit in memory."""
    name = Path(path).name
    with pa.OSFile(str(path)) as stream, pq.ParquetFile(stream) as file:
        names = file.schema_arrow.names
        chosen = names if columns is None else [column for column in columns if column in names]
        where = name if columns is None or len(columns) > 1 else f"{name}, column {columns[0]!r}"
        check_memory(sum(check_sizes(file, chosen, path)), where)
        table = file.read(chosen, use_threads=False)
    check_table(table, name)
    return table


def check_table(table: pa.Table, name: str) -> None:
    """A `DataError` where a text or a list of a file called `name` is longer than any of a step."""
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


def check_sizes(file: pq.ParquetFile, columns: Collection[str], path: StrPath) -> list[int]:
    """The bytes that `columns` of the open file at `path` take in memory in each row group, by its footer.

    An error where a batch of rows does not fit in memory, where a column of numbers, texts or lists has more than its
    rows can hold, or where pages of lists hold more than the footer says.
    """
    name, sizes, kinds = Path(path).name, list[int](), {one.name: kind_of_type(one.type) for one in file.schema_arrow}
    owners = (field.name for field in file.schema_arrow for _ in range(_n_parts(field.type)))
    chosen = {k: column for k, column in enumerate(owners) if column in columns}
    for group in map(file.metadata.row_group, range(file.num_row_groups)):
        n_bytes, most = 0, BYTES_PER_NUMBER * _LONGEST_VALUE * group.num_rows + _LARGEST_PAGE
        for k, column in chosen.items():
            chunk = group.column(k)
            size = max(BYTES_PER_NUMBER * chunk.num_values, chunk.total_uncompressed_size)
            if size > most and kinds[column] in ("number", "text", "list"):
                fault = f"column {column!r} declares {size:,} bytes for {group.num_rows:,} rows, more than steps have"
                raise DataError(f"{name}: {fault}; write shorter values, or drop the column.")
            n_bytes += size
        check_free(n_bytes * min(1.0, BATCH_ROWS / max(group.num_rows, 1)))
        sizes.append(n_bytes)
    if lists := [k for k in chosen if file.schema.column(k).max_repetition_level]:
        with pa.OSFile(str(path)) as stream:
            check_pages(file, stream, lists, name)
    return sizes


def _n_parts(kind: pa.DataType) -> int:
    """The parts of a column of nested values, which have a column of their own in the file each; else 1."""
    stored = getattr(kind, "storage_type", kind)
    return sum(_n_parts(stored.field(k).type) for k in range(stored.num_fields)) or 1


_PAGE_BYTES, _N_VALUES, _N_VALUES_2 = (3,), (5, 1), (8, 1)
"""Fields of the header of a page: its bytes in the file, and its values in the versions 1 and 2 of pages."""


def check_pages(file: pq.ParquetFile, stream: pa.NativeFile, columns: Collection[int], name: str) -> None:
    """A `DataError` where pages of the `columns`, by number, hold more values than the footer of the file `name` says.

    A value that repeats is stored once, so that a kilobyte may hold a list of 10^9 numbers, and a reader believes the
    pages, not the footer. Thrift encodes their headers, and pyarrow hides them. Other errors are of a damaged file.
    """
    for number in range(file.num_row_groups):
        for chunk in map(file.metadata.row_group(number).column, columns):
            place, n_values = chunk.data_page_offset, 0
            end = (chunk.dictionary_page_offset or place) + chunk.total_compressed_size
            while place < end:
                content = io.BytesIO(stream.read_at(MIB, place))  # most writers shorten the texts in it to 4,096 bytes
                header = fields_of(content)
                n_values += header.get(_N_VALUES, header.get(_N_VALUES_2, 0))
                place += content.tell() + max(header[_PAGE_BYTES], 0)
                if n_values > chunk.num_values:
                    fault = f"pages of {chunk.path_in_schema} hold more values than its footer says"
                    raise DataError(f"{name}: {fault}; it is damaged, write it again.")


def fields_of(content: io.BytesIO) -> dict[tuple[int, ...], int]:
    """The integers of the object of Thrift at the place of `content`, which is then behind it, by the number of the
    field, after those of the objects that it is in."""
    found, number = dict[tuple[int, ...], int](), 0
    while head := content.read(1)[0]:
        kind, number = head & 15, number + (head >> 4) if head >> 4 else _signed(content)
        if kind in (4, 5, 6):  # integers
            found[number,] = _signed(content)
        elif kind == 12:  # an object
            found |= {(number, *inner): value for inner, value in fields_of(content).items()}
        elif kind in (3, 7, 8):  # a byte, a number of 8 bytes, a text
            content.seek({3: 1, 7: 8}.get(kind) or _unsigned(content), io.SEEK_CUR)
    return found


def _signed(content: io.BytesIO) -> int:
    number = _unsigned(content)
    return number >> 1 ^ -(number & 1)


def _unsigned(content: io.BytesIO) -> int:
    number = shift = 0
    while (byte := content.read(1)[0]) & 128:
        number, shift = number | (byte & 127) << shift, shift + 7
    return number | byte << shift
