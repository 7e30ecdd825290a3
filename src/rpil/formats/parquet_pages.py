"""What the columns of a Parquet file take in memory, by the headers of their pages, before any is decoded.

A value that repeats is stored once, so that a kilobyte may hold 10^9 letters, or a list of 10^9 numbers: neither the
number of rows nor the size of the file tells. The footer does, but a reader believes the pages. pyarrow does not show
their headers, and to ask it for a column of a damaged footer may end the process. Both are encoded by Thrift.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NamedTuple

from rpil.data.errors import DataError
from rpil.data.held import held
from rpil.data.memory import BYTES_PER_NUMBER, check_memory

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq
    from pyarrow import fs

Fields = dict[int, Any]
"""An object of Thrift: its values by the numbers of their fields."""

_TAIL = 8  # bytes at the end of a file: the length of the footer, and a mark
_FIRST_HEADER, _LONGEST_HEADER = 256, 2**24  # bytes of the header of a page that are read at first, and at most
_MAX_DEPTH = 16
_LARGEST_PAGE = 2**28  # bytes, which are decoded at once, and may be whatever the memory
_LONGEST_LIST = 2**20  # numbers of a step
_TRUE, _FALSE, _BYTE, _DOUBLE, _BINARY, _LIST, _SET, _STRUCT = 1, 2, 3, 7, 8, 9, 10, 12  # types of Thrift
_ROW_GROUPS, _COLUMNS, _ABOUT = 4, 1, 3  # fields of the footer, of a row group and of a column in it
_PACKED_BYTES, _DATA_PAGE, _DICTIONARY_PAGE = 7, 9, 11  # fields of what is said about a column
_DECODED_BYTES, _PAGE_BYTES, _PAGE, _PAGE_2, _N_VALUES = 2, 3, 5, 8, 1  # fields of the header of a page


def check_pages(stored: OpenParquet, columns: Collection[str]) -> int:
    """The bytes that `columns` take in memory.

    A `DataError` where the file is damaged, a page is larger than any that is written, or a row group has many numbers
    in lists, which may all be in one list, and they do not fit in memory, are not as many in each row, or are more than
    a step has.
    """
    return sum(_group_bytes(stored, columns))


def check_groups(stored: OpenParquet) -> None:
    """A `DataError` as of `check_pages`, or where the columns of one row group do not fit in memory."""
    check_memory(max(_group_bytes(stored, stored.file.schema_arrow.names), default=0), stored.name)


def _group_bytes(stored: OpenParquet, columns: Collection[str]) -> list[int]:
    """The bytes that `columns` take in memory in each row group; errors are those of `check_pages`."""
    name, found = stored.name, []
    for number, chunks in enumerate(page_sizes(stored, columns)):
        if any(chunk.largest > _LARGEST_PAGE for chunk in chunks):
            raise DataError(f"{name}: a page of it has over {_LARGEST_PAGE // 2**20} MiB; write it with smaller pages.")
        n = sum(chunk.n_values for chunk in chunks if chunk.is_list)
        if BYTES_PER_NUMBER * n > _LARGEST_PAGE:
            check_memory(BYTES_PER_NUMBER * n, f"{name}, the lists of a row group")
            n_rows = max(stored.file.metadata.row_group(number).num_rows, 1)
            if n % n_rows or n // n_rows > _LONGEST_LIST:
                raise DataError(
                    f"{name}: lists hold {n:,} numbers in {n_rows:,} rows; write as many in every row, and "
                    f"{_LONGEST_LIST:,} at most, or leave them out with <option>.",
                    "exclude",
                )
        found.append(sum(max(BYTES_PER_NUMBER * chunk.n_values, chunk.n_bytes) for chunk in chunks))
    return found


def input_file(filesystem: fs.FileSystem, path: PurePath | str) -> AbstractContextManager[pa.NativeFile]:
    """The bytes of a file; see `rpil.data.held`."""
    return held(str(path), lambda: filesystem.open_input_file(str(path)), filesystem.type_name)


@contextmanager
def open_table(path: PurePath | str, filesystem: fs.FileSystem | None = None) -> Iterator[OpenParquet]:
    """A local Parquet file, or one in a `filesystem`; errors of pyarrow are left as they are."""
    import pyarrow.parquet as pq
    from pyarrow import fs

    with input_file(filesystem or fs.LocalFileSystem(), path) as stream, pq.ParquetFile(stream) as file:
        yield OpenParquet(file, stream, PurePath(path).name)


def read_table(
    path: PurePath | str, columns: Sequence[str] | None = None, filesystem: fs.FileSystem | None = None
) -> pa.Table:
    """The rows of a file that `open_table` opens; see `OpenParquet.read`."""
    with open_table(path, filesystem) as stored:
        return stored.read(columns)


class OpenParquet(NamedTuple):
    """An open Parquet file, the stream of its bytes, and its name in messages."""

    file: pq.ParquetFile
    stream: pa.NativeFile
    name: str

    def read(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Those of the columns that are there, by default all; a `DataError` where they do not fit in memory."""
        names = self.file.schema_arrow.names
        chosen = names if columns is None else [name for name in columns if name in names]
        where = self.name if columns is None or len(columns) > 1 else f"{self.name}, column {columns[0]!r}"
        check_memory(check_pages(self, chosen), where)
        return self.file.read(chosen)


class Chunk(NamedTuple):
    """What a column holds in a row group, by its pages: values, bytes, those of its largest page; whether in lists."""

    n_values: int
    n_bytes: int
    largest: int
    is_list: bool


def page_sizes(stored: OpenParquet, columns: Collection[str]) -> list[list[Chunk]]:
    """What `columns` hold in each row group; a `DataError` where the file is damaged."""
    schema, names, stream = stored.file.schema, set(stored.file.schema_arrow.names), stored.stream
    wanted = set(columns)
    parts = [(k, schema.column(k)) for k in range(len(schema))]
    chosen = [(k, part.max_repetition_level > 0) for k, part in parts if _column_of(part.path, names) in wanted]
    try:
        groups = _footer(stream)[_ROW_GROUPS]
        return [[_chunk(stream, group[_COLUMNS][k], is_list) for k, is_list in chosen] for group in groups]
    except (LookupError, TypeError, ValueError, RecursionError) as error:
        raise DataError(f"{stored.name}: a damaged Parquet file; write it again.") from error


def _column_of(path: str, names: Collection[str]) -> str:
    """The column, one of the `names`, which may have dots, of a part of it at a path such as ``x.list.element``."""
    while path not in names and path:
        path = path.rpartition(".")[0]
    return path


def _footer(stream: pa.NativeFile) -> Fields:
    size = stream.size()
    n_bytes = int.from_bytes(stream.read_at(4, size - _TAIL), "little")
    return _Reader(stream.read_at(min(n_bytes, size), max(size - _TAIL - n_bytes, 0))).fields()


def _chunk(stream: pa.NativeFile, column: Fields, is_list: bool) -> Chunk:
    about = column[_ABOUT]
    place = min(about[field] for field in (_DATA_PAGE, _DICTIONARY_PAGE) if about.get(field))
    end, n_values, sizes = place + about[_PACKED_BYTES], 0, [0]
    while place < end:
        n_bytes, page = _page_header(stream, place)
        values = page.get(_PAGE) or page.get(_PAGE_2) or {_N_VALUES: 0}  # a dictionary's are no values of a row
        if min(values[_N_VALUES], page[_PAGE_BYTES], page[_DECODED_BYTES]) < 0:
            raise ValueError(place)
        n_values += values[_N_VALUES]
        sizes.append(page[_DECODED_BYTES])
        place += n_bytes + page[_PAGE_BYTES]
    return Chunk(n_values, sum(sizes), max(sizes), is_list)


def _page_header(stream: pa.NativeFile, place: int) -> tuple[int, Fields]:
    """The length of the header of the page at a place, and the header."""
    n_bytes = _FIRST_HEADER
    while True:
        reader = _Reader(stream.read_at(n_bytes, place))
        try:
            header = reader.fields()
            return reader.place, header
        except IndexError:
            if n_bytes > min(len(reader.content), _LONGEST_HEADER):
                raise
            n_bytes *= 8


class _Reader:
    """Objects of Thrift in its compact encoding; an `IndexError` where one ends early, a `ValueError` for no Thrift."""

    def __init__(self, content: bytes) -> None:
        self.content, self.place = content, 0

    def fields(self, depth: int = 0) -> Fields:
        """The values of an object; texts are left out."""
        found: Fields = {}
        number = 0
        while head := self.content[self.place]:
            self.place += 1
            number = number + (head >> 4) if head >> 4 else self._signed()
            kind = head & 15
            if _BYTE < kind < _DOUBLE:
                found[number] = self._signed()
            elif kind not in (_TRUE, _FALSE):  # which are in the head
                found[number] = self._value(kind, depth)
        self.place += 1
        return found

    def _value(self, kind: int, depth: int) -> object:
        if kind == _BINARY:
            self._skip(self._unsigned())
            return None
        if kind == _STRUCT and depth < _MAX_DEPTH:
            return self.fields(depth + 1)
        if kind in (_LIST, _SET) and depth < _MAX_DEPTH:
            head = self.content[self.place]
            self.place += 1
            size = self._unsigned() if head >> 4 == 15 else head >> 4
            return [self._value(head & 15, depth + 1) for _ in range(size)]
        if _BYTE < kind < _DOUBLE:
            return self._signed()
        if kind in (_TRUE, _FALSE, _BYTE, _DOUBLE):
            self._skip(8 if kind == _DOUBLE else 1)
            return None
        raise ValueError(kind)

    def _skip(self, n_bytes: int) -> None:
        """Go on after what nothing here needs."""
        self.place += n_bytes
        if self.place > len(self.content):
            raise IndexError(self.place)

    def _unsigned(self) -> int:
        byte = self.content[self.place]
        self.place += 1
        number, shift = byte & 127, 7
        while byte & 128:
            byte = self.content[self.place]
            self.place += 1
            number, shift = number | (byte & 127) << shift, shift + 7
            if shift > 70:
                raise ValueError(shift)
        return number

    def _signed(self) -> int:
        number = self._unsigned()
        return number >> 1 ^ -(number & 1)
