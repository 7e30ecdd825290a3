"""The rows of a recording, read table by table: in memory, or of Parquet files, which stay on disk.

Of Parquet files there are those of the user, and copies of what other formats hold.
Passes over Parquet take less time than decoding text, HDF5 or Zarr again in each of them, and need one way of reading
only. A copy is removed when its rows are no longer needed, or when the process ends.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, groupby
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import fs

from rpil.data.arrays import check_any
from rpil.data.errors import DataError
from rpil.data.files import refuse_pointer
from rpil.data.guard import guarded
from rpil.data.names import quoted
from rpil.formats.parquet_file import check_table, input_file
from rpil.formats.table import BATCH_ROWS, Place
from rpil.numerics.types import Array, Int

_BUFFER_BYTES = 262_144  # of a column, read at a time: a row group need not fit in memory


@dataclass(frozen=True, eq=False)
class TableRows:
    """The rows of a table in memory, which is called `source` in messages.

    `place` (N,) is the number that each has in the files; None where all stay where they are, and none is left out.
    `sizes` are the numbers of rows from each file; there are none for formats in which files say nothing of
    demonstrations.
    """

    table: pa.Table
    source: str
    place: Array | None = None
    sizes: Mapping[str, int] = field(default_factory=dict)

    @property
    def schema(self) -> pa.Schema:
        """The columns, and their types."""
        return self.table.schema

    @property
    def moved(self) -> bool:
        """Whether rows are left out, or lie elsewhere than in the files."""
        return self.place is not None

    def __len__(self) -> int:
        return len(self.table)

    def taken(self, rows: Array) -> TableRows:
        """Some of the rows, in this order."""
        return replace(self, table=self.table.take(rows), place=self.numbers(rows))

    def chosen(self, runs: Int[Array, "K 2"]) -> TableRows:
        """The rows ``begin:end`` of each of the `runs`, which are in order, numbered anew from 0."""
        if runs.tolist() == [[0, len(self)]]:
            return self
        return self.taken(np.concatenate([np.arange(begin, end) for begin, end in runs.tolist()]))

    def tables(
        self, first: int, last: int, columns: list[str], demonstration: Place = lambda _: ""
    ) -> Iterator[tuple[int, pa.Table, Place]]:
        """Rows ``first:last`` in tables: the first row of each, the table, and the place of a row of it for messages.

        `demonstration` names the demonstration of a row of the recording.
        """
        table, row_of = self.table.select(columns), range(last) if self.place is None else self.place
        for row in range(first, last, BATCH_ROWS):
            here = table.slice(row, min(BATCH_ROWS, last - row))
            yield row, here, shifted(lambda k: f"{self.source}{demonstration(k)}, row {row_of[k] + 1}", row)

    def numbers(self, rows: Array) -> Array:
        """The numbers that some rows have in the files, one below the other, from 0."""
        return rows if self.place is None else self.place[rows]


class Piece(NamedTuple):
    """The rows ``begin:end`` of row group `number`, which has `n_rows`, of the file `path`.

    The first row of the group is row `row` of the file and `place` of the data set.
    """

    path: str
    number: int
    n_rows: int
    begin: int
    end: int
    row: int
    place: int


@dataclass(frozen=True, eq=False)
class ParquetRows:
    """The rows of Parquet files: their pieces in order, with the types of `schema`."""

    filesystem: fs.FileSystem
    pieces: tuple[Piece, ...]
    schema: pa.Schema
    n_bytes: int
    """Of all columns that are read, decoded, at most."""
    keeper: object = None
    """What keeps a copy for as long as its rows are needed."""
    sizes: Mapping[str, int] = field(default_factory=dict)
    moved: bool = False

    @cached_property
    def _first(self) -> Int[Array, " _"]:
        """The number of the first row of each piece, and of the one after the last."""
        return np.append(0, np.cumsum([piece.end - piece.begin for piece in self.pieces]))

    def __len__(self) -> int:
        return int(self._first[-1])

    def chosen(self, runs: Int[Array, "K 2"]) -> ParquetRows:
        found = []  # row groups of which none is chosen are not read
        for piece, first in zip(self.pieces, self._first.tolist(), strict=False):
            shift, last = piece.begin - first, first + piece.end - piece.begin
            own = slice(np.searchsorted(runs[:, 1], first, "right"), np.searchsorted(runs[:, 0], last))
            for begin, end in runs[own].tolist():
                cut = {"begin": max(begin + shift, piece.begin), "end": min(end + shift, piece.end)}
                found.append(piece._replace(**cut))
        return replace(self, pieces=tuple(found), moved=True)

    def numbers(self, rows: Array) -> Array:
        shifts = np.array([piece.place + piece.begin for piece in self.pieces]) - self._first[:-1]
        return np.asarray(rows + shifts[np.searchsorted(self._first, rows, side="right") - 1])

    def tables(
        self, first: int, last: int, columns: list[str], demonstration: Place = lambda _: ""
    ) -> Iterator[tuple[int, pa.Table, Place]]:
        schema = pa.schema([self.schema.field(name) for name in columns])
        numbered = zip(self.pieces, self._first, strict=False)
        there = [(p, int(k) - p.begin) for p, k in numbered if k < last and first < k + p.end - p.begin]
        for path, of_file in groupby(there, lambda one: one[0].path):
            name = PurePosixPath(path).name
            with opened(self.filesystem, path) as file:
                for number, of_group in groupby(of_file, lambda one: one[0].number):
                    own, row = [*of_group], 0
                    n_rows = own[0][0].n_rows
                    if number >= file.num_row_groups or file.metadata.row_group(number).num_rows != n_rows:
                        raise DataError(f"{name}: it has changed since the data set was opened; open it again.")
                    for batch in file.iter_batches(BATCH_ROWS, [number], columns, use_threads=False):
                        for piece, shift in own:
                            a = max(piece.begin, first - shift, row)
                            b = min(piece.end, last - shift, row + len(batch))
                            if a < b:
                                table = pa.Table.from_batches([batch.slice(a - row, b - a)])
                                check_table(table, name)
                                table = table if table.schema.equals(schema) else table.cast(schema)
                                yield a + shift, table, _place(name, a + shift, piece.row + a, demonstration)
                        row += len(batch)
                    if row != n_rows:
                        raise ValueError(f"{row} of {n_rows} rows are there")


def _place(name: str, first: int, row_of_file: int, demonstration: Place) -> Place:
    return lambda row: f"{name}{demonstration(first + row)}, row {row_of_file + row + 1}"


Rows = TableRows | ParquetRows
"""Those of a recording, with those of each demonstration together."""


def files_of(rows: Rows, some: Array) -> list[str]:
    """The file of each of `some` rows, no two alike; none where files say nothing of demonstrations."""
    names, ends = list(rows.sizes), np.cumsum(list(rows.sizes.values()))
    return [names[k] for k in np.searchsorted(ends, rows.numbers(some), side="right").tolist()] if names else []


def shifted(at: Place, rows: int) -> Place:
    """`at` for a table without its first `rows`."""
    return lambda row: at(rows + row)


def read_columns(rows: Rows, names: list[str], steps: slice | None = None) -> pa.Table:
    """Some columns of some of the rows, or of all."""
    first, last = (0, len(rows)) if steps is None else (steps.start, steps.stop)
    tables = [table for _, table, _ in rows.tables(first, last, names)] if names else []
    return pa.concat_tables(tables, promote_options="permissive") if tables else pa.table({})


def rows_of(
    file: pq.ParquetFile, filesystem: fs.FileSystem, path: str, names: Collection[str], n_bytes: int
) -> ParquetRows:
    """The rows of an open file, with those of the columns `names` that are there, which take `n_bytes` in memory."""
    counts = [file.metadata.row_group(number).num_rows for number in range(file.num_row_groups)]
    starts = np.append(0, np.cumsum(counts)).tolist()
    pieces = (Piece(path, k, n, 0, n, start, start) for k, (n, start) in enumerate(zip(counts, starts, strict=False)))
    return ParquetRows(
        filesystem, tuple(pieces), pa.schema([one for one in file.schema_arrow if one.name in names]), n_bytes
    )


def end_to_end(parts: Sequence[ParquetRows], names: Sequence[str]) -> ParquetRows:
    """The rows of files called `names`, one below the other; a `DataError` where a column has types that differ."""
    pieces, schema, n_rows = list[Piece](), parts[0].schema, 0
    for rows, name in zip(parts, names, strict=True):
        pieces += [piece._replace(place=piece.place + n_rows) for piece in rows.pieces]
        n_rows += len(rows)
        try:
            schema = pa.unify_schemas([schema, rows.schema], promote_options="permissive")
        except pa.ArrowException as error:
            raise other_columns(name, names[0]) from error
    sizes = {name: len(rows) for rows, name in zip(parts, names, strict=True)}
    n_bytes, keeper = sum(rows.n_bytes for rows in parts), [rows.keeper for rows in parts if rows.keeper]
    return replace(parts[0], pieces=tuple(pieces), schema=schema, n_bytes=n_bytes, keeper=keeper, sizes=sizes)


def other_columns(name: str, first: str, names: Collection[str] = (), known: Collection[str] = ()) -> DataError:
    """The error that the file `name` has other columns, these `names`, than the file `first`."""
    differ = (quoted(sorted({*some} - {*others}), 5) for some, others in ((known, names), (names, known)))
    which = " and ".join(f"{what} {some}" for what, some in zip(("without", "with"), differ, strict=True) if some)
    said = f"its columns are not those of {first}{which and f' ({which})'}"
    return DataError(f"{name}: {said}; give all files the same ones, or take it out.")


@contextmanager
def opened(filesystem: fs.FileSystem, path: str) -> Iterator[pq.ParquetFile]:
    """The open file, whose checksums are compared as it is read; a `DataError` where it is no Parquet file."""
    try:
        # Neither mapped into memory, where mapped pages stay and count, nor fetched by whole row groups.
        options = {"buffer_size": _BUFFER_BYTES, "pre_buffer": False, "page_checksum_verification": True}
        with input_file(filesystem, path) as stream, pq.ParquetFile(stream, **options) as file:
            # A text that repeats stays in memory once.
            texts = [field.name for field in file.schema_arrow if pa.types.is_string(field.type)]
            if texts:
                file = pq.ParquetFile(stream, metadata=file.metadata, read_dictionary=texts, **options)
            yield file
    except FileNotFoundError as error:
        raise DataError(f"{path}: there is no such file here; check the path.") from error
    except DataError:
        raise
    except Exception:
        with guarded(PurePosixPath(path).name, "not a Parquet file, or a damaged or truncated one", "write it again"):
            with input_file(filesystem, path) as stream:
                refuse_pointer(stream.read_at(100, 0), PurePosixPath(path).name)
            raise


class Copy:
    """A temporary file, called as the data, in its own folder; both are removed with the object, by its process."""

    def __init__(self, name: str) -> None:
        folder = tempfile.mkdtemp(prefix="rpil-")
        weakref.finalize(self, _remove, folder, os.getpid())
        own = Path(name).name  # "." has none, and ".." would be the folder of temporary files
        self.path = Path(folder, own if own.strip(".") else "rows")

    def __reduce__(self) -> tuple[type[Path], tuple[str]]:
        """Another process reads the file and never removes it."""
        return Path, (str(self.path),)


def _remove(folder: str, process: int) -> None:
    if os.getpid() == process:  # and not a process that was forked from it
        shutil.rmtree(folder, ignore_errors=True)


def copied(tables: Iterable[pa.Table], source: str, sizes: Mapping[str, int]) -> ParquetRows:
    """The rows of `tables`, from files of these sizes, in a temporary Parquet file called as the `source`.

    A `DataError` where it cannot be written, where there are no tables, or where they have columns of other types.
    """
    waiting = iter(tables)
    first = next(waiting, None)
    check_any(int(first is not None), source)
    assert first is not None
    with _writing(source):
        copy = Copy(source)
        writer = pq.ParquetWriter(copy.path, first.schema, compression="lz4", write_statistics=False)
    for group in _groups(chain([first], waiting), source):  # whose errors are those of the data
        with _writing(source):
            writer.write_table(group)
    with _writing(source):
        writer.close()
    filesystem, path = fs.LocalFileSystem(), str(copy.path)
    with opened(filesystem, path) as file:
        return replace(rows_of(file, filesystem, path, first.column_names, 0), keeper=copy, sizes=sizes)


def _groups(tables: Iterable[pa.Table], source: str) -> Iterator[pa.Table]:
    """Tables of the types of the first, joined to row groups."""
    group: list[pa.Table] = []
    for table in tables:
        try:
            group.append(table.cast(group[0].schema) if group else table)
        except (pa.ArrowInvalid, ValueError) as error:
            said = "a column holds values of other types further on; write them alike, or allow more with <option>"
            raise DataError(f"{source}: {said}.", "memory") from error
        if sum(map(len, group)) >= BATCH_ROWS:
            yield pa.concat_tables(group)
            group = [group[0].slice(0, 0)]
    yield pa.concat_tables(group)


@contextmanager
def _writing(name: str) -> Iterator[None]:
    """Name the folder of the copy in errors of writing."""
    try:
        yield
    except OSError as error:
        raise DataError(
            f"{name}: a copy of its rows cannot be written to {os.environ.get('TMPDIR', 'the temporary folder')} "
            f"({error.strerror or 'it cannot be used'}); set TMPDIR to another folder, or read the data into memory."
        ) from error
