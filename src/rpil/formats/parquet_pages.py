"""Values of lists by the headers of the pages of a Parquet file, before any is decoded.

A value that repeats is stored once, so that a kilobyte may hold a list of 10^9 numbers. The footer says how many there
are, but a reader believes the pages. Their headers are encoded by Thrift, and pyarrow does not show them.
"""

from __future__ import annotations

import io
from collections.abc import Collection

import pyarrow as pa
import pyarrow.parquet as pq

from rpil.data.errors import DataError
from rpil.data.memory import MIB

Fields = dict[tuple[int, ...], int]
"""The integers in an object of Thrift by the number of the field, with those of the objects that it is in."""

_PAGE_BYTES, _N_VALUES, _N_VALUES_2 = (3,), (5, 1), (8, 1)
"""Fields of the header of a page: its bytes in the file, and its values in the versions 1 and 2 of pages."""


def check_pages(file: pq.ParquetFile, stream: pa.NativeFile, columns: Collection[int], name: str) -> None:
    """A `DataError` where pages of the `columns`, by number, hold more values than the footer of the file `name` says.

    Errors of another type are those of a damaged file.
    """
    for number in range(file.num_row_groups):
        group = file.metadata.row_group(number)
        for chunk in map(group.column, columns):
            place, n_values = chunk.data_page_offset, 0
            end = (chunk.dictionary_page_offset or place) + chunk.total_compressed_size
            while place < end:
                header, n_bytes = _header_at(stream, place)
                n_values += header.get(_N_VALUES, header.get(_N_VALUES_2, 0))
                place += n_bytes + max(header[_PAGE_BYTES], 0)
                if n_values > chunk.num_values:
                    fault = f"pages of {chunk.path_in_schema} hold more values than its footer says"
                    raise DataError(f"{name}: {fault}; it is damaged, write it again.")


def _header_at(stream: pa.NativeFile, place: int) -> tuple[Fields, int]:
    """The header of the page at a place, and its length."""
    content = io.BytesIO(stream.read_at(4096, place))
    try:
        return _fields(content), content.tell()
    except IndexError:  # it has long texts
        content = io.BytesIO(stream.read_at(16 * MIB, place))
        return _fields(content), content.tell()


def _fields(content: io.BytesIO) -> Fields:
    found: Fields = {}
    number = 0
    while head := content.read(1)[0]:
        kind, number = head & 15, number + (head >> 4) if head >> 4 else _signed(content)
        if kind in (4, 5, 6):  # integers
            found[number,] = _signed(content)
        elif kind == 12:  # an object
            found |= {(number, *inner): value for inner, value in _fields(content).items()}
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
