"""The steps of a recording: an Arrow table in memory, or one in a temporary file, which is read in the same batches.

What does not fit in memory is written once to a file of Arrow, whatever its format, because a fit makes dozens of
passes. The file is removed when its rows are no longer needed, or when the process ends.
"""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import compress

import numpy as np
import pyarrow as pa

from rpil.data.arrays import Id, check_any
from rpil.data.errors import DataError, guarded
from rpil.formats.table import BATCH_ROWS, Place, plain_type
from rpil.numerics.types import Array, Int

_BATCHES_AT_ONCE = 16
"""Batches that are put in another order together, each of which may be all over the file."""


class ArrowFile:
    """A temporary file of Arrow with batches of `BATCH_ROWS` rows; it goes with the object that wrote it.

    Where the system can, it has an open `handle`, and no name until another process needs one: no end leaves it behind.
    """

    def __init__(self, path: str, schema: pa.Schema, n_rows: int, handle: int = -1) -> None:
        self.path, self.schema, self._n_rows, self._handle = path, schema, n_rows, handle
        self._last: tuple[tuple[int | str, ...], pa.Table] | None = None

    def __len__(self) -> int:
        return self._n_rows

    def __reduce__(self) -> tuple[type[ArrowFile], tuple[object, ...]]:
        """Another process reads the file, maybe on another machine, and never removes it."""
        if (handle := self._handle) >= 0:
            name = os.path.join(tempfile.gettempdir(), f"rpil-{os.getpid()}-{handle}.arrow")
            with suppress(FileExistsError):  # where two threads send it
                os.link(self.path, name, src_dir_fd=handle)  # with which links are followed
            weakref.finalize(self, _remove, name, os.getpid())
            self.path, self._handle = name, -1
        return ArrowFile, (self.path, self.schema, self._n_rows)

    def batch(self, number: int, columns: Sequence[str]) -> pa.Table:
        """Some columns of a batch; its pages are mapped into memory for as long as the table is there."""
        if self._last is not None and self._last[0] == (number, *columns):  # which small blocks ask for again
            return self._last[1]
        with guarded(self.path), pa.memory_map(self.path) as mapped:
            # Without `included_fields`, with which pyarrow copies the batch, of all columns, into memory.
            table = pa.Table.from_batches([pa.ipc.open_file(mapped).get_batch(number)]).select(columns)
        self._last = (number, *columns), table
        return table

    @classmethod
    def of(cls, tables: Iterable[pa.Table], source: str, n_rows: int = 0) -> ArrowFile:
        """The file of `tables` one below the other, which is called `source` in messages.

        A `DataError` where it cannot be written, as where there is no room for `n_rows`, where there are no tables, or
        where they have columns of other types.
        """
        first = next(waiting := iter(tables), None)
        check_any(int(first is not None), source)
        assert first is not None
        schema = pa.schema([one.with_type(plain_type(one.type)) for one in first.schema])
        with _writing(source):
            path, handle = _new_file(first.nbytes / max(len(first), 1) * n_rows)
            new = cls(path, schema, 0, handle)
            weakref.finalize(new, *((_remove, path, os.getpid()) if handle < 0 else (os.close, handle)))
            sink = pa.OSFile(path, "wb")
            writer = pa.ipc.new_file(sink, schema)
        for batch in _batches(first, waiting, schema, source):  # whose errors are those of the data
            new._n_rows += len(batch)
            with _writing(source):
                writer.write_batch(batch)
        with _writing(source):
            writer.close()
            sink.close()
        return new


def _new_file(n_bytes: float) -> tuple[str, int]:
    """The path of a new temporary file, which is to have `n_bytes`, and its handle if it has no name, else -1."""
    folder = os.environ.get("TMPDIR") or tempfile.gettempdir()
    if not os.access(folder, os.W_OK | os.X_OK):  # Python takes another one then, which may be too small
        raise OSError(errno.ENOENT, f"TMPDIR is {folder}, where no file can be written")
    if n_bytes > (free := shutil.disk_usage(tempfile.gettempdir()).free):
        raise OSError(errno.ENOSPC, f"it needs {n_bytes / 1e9:,.2f} GB, and {free / 1e9:,.2f} GB are free")
    try:
        handle = os.open(tempfile.gettempdir(), os.O_TMPFILE | os.O_RDWR, 0o600)
        os.stat(path := f"/proc/{os.getpid()}/fd/{handle}")
    except (AttributeError, OSError):
        written, path = tempfile.mkstemp(".arrow", "rpil-")
        os.close(written)
        return path, -1
    return path, handle


def _remove(path: str, process: int) -> None:
    if os.getpid() == process:  # and not a process that was forked from it
        with suppress(OSError):
            os.unlink(path)


def _batches(first: pa.Table, others: Iterator[pa.Table], schema: pa.Schema, source: str) -> Iterator[pa.RecordBatch]:
    """The rows of tables in batches of the same size, but for the last one."""
    waiting, table = schema.empty_table(), first
    while table is not None:
        try:
            waiting = pa.concat_tables([waiting, table.cast(schema)])
        except (pa.ArrowInvalid, ValueError) as error:
            said = "a column holds values of other types further on; write them alike, or allow more with --memory"
            raise DataError(f"{source}: {said}.") from error
        table = next(others, None)
        while len(waiting) >= BATCH_ROWS or (table is None and len(waiting)):
            yield waiting.slice(0, BATCH_ROWS).combine_chunks().to_batches()[0]
            waiting = waiting.slice(BATCH_ROWS)


@contextmanager
def _writing(name: str) -> Iterator[None]:
    """Name the folder of the copy in errors of writing."""
    try:
        yield
    except OSError as error:
        why = error.strerror or "it cannot be used"
        said = f"a copy of its rows cannot be written to {tempfile.gettempdir()} ({why})"
        raise DataError(f"{name}: {said}; set TMPDIR to another folder, or allow more with --memory.") from error


@dataclass(frozen=True, eq=False)
class Steps:
    """The steps of M demonstrations end to end, in order, a row of the `table` each."""

    table: pa.Table | ArrowFile
    source: str  # the name of the data in messages
    sizes: Mapping[str, int] = field(default_factory=dict)  # rows of each file, where files tell of demonstrations
    place: Array | None = None  # (N,), of each row in the files; None where all are there and stay where they are
    ids: tuple[Id, ...] = ()  # none before the demonstrations are known
    offsets: Int[Array, " _"] = field(default_factory=lambda: np.zeros(1, np.int64))  # (M + 1,)

    def __len__(self) -> int:
        return len(self.table)

    def taken(self, rows: Array) -> Steps:
        """Some of the rows, in this order."""
        if isinstance(self.table, pa.Table):
            return replace(self, table=self.table.take(rows), place=self.numbers(rows))
        table, n_rows = self.table, _BATCHES_AT_ONCE * BATCH_ROWS

        def some(part: Array) -> pa.Table:
            order = np.argsort(part, kind="stable")
            numbers, starts = np.unique((own := part[order]) // BATCH_ROWS, return_index=True)
            each = zip(numbers.tolist(), np.split(own, starts[1:]), strict=True)
            found = [table.batch(k, table.schema.names).take(rows - k * BATCH_ROWS) for k, rows in each]
            return pa.concat_tables(found).take(np.argsort(order))

        parts = map(some, np.split(rows, range(n_rows, len(rows), n_rows)))
        return replace(self, table=ArrowFile.of(parts, self.source, len(rows)), place=self.numbers(rows))

    def only(self, mask: Array) -> Steps:
        """The demonstrations of a mask (M,) alone."""
        if mask.all():
            return self
        lengths = np.diff(self.offsets)
        ids, offsets = tuple(compress(self.ids, mask)), np.append(0, np.cumsum(lengths[mask]))
        return replace(self.taken(np.flatnonzero(np.repeat(mask, lengths))), ids=ids, offsets=offsets)

    def tables(
        self, columns: Sequence[str], first: int = 0, last: int | None = None
    ) -> Iterator[tuple[int, pa.Table, Place]]:
        """Rows ``first:last`` in tables: the first row of each, the table, and the place of a row for messages."""
        last = len(self) if last is None else last
        whole = self.table.select(columns) if isinstance(self.table, pa.Table) else None
        for start in range(first - first % BATCH_ROWS, last, BATCH_ROWS):
            a, b = max(start, first), min(start + BATCH_ROWS, last)
            table = self.table.batch(start // BATCH_ROWS, columns).slice(a - start) if whole is None else whole.slice(a)
            yield a, table.slice(0, b - a), partial(self.place_of, a)

    def place_of(self, first: int, row: int) -> str:
        """The file, the demonstration, and the number in the file of row ``first + row``, for messages."""
        m = int(np.searchsorted(self.offsets, first + row, side="right")) - 1
        number, name = int(self.numbers(np.array([first + row]))[0]), self.source
        if len(self.sizes) > 1:
            ends = np.cumsum([0, *self.sizes.values()])
            k = int(np.searchsorted(ends, number, side="right")) - 1
            number, name = number - int(ends[k]), [*self.sizes][k]
        return f"{name}{f', demonstration {self.ids[m]!r}' if m < len(self.ids) else ''}, row {number + 1}"

    def numbers(self, rows: Array) -> Array:
        """The numbers that some rows have in the files, one below the other, from 0."""
        return rows if self.place is None else self.place[rows]

    def files(self, some: Array) -> list[str]:
        """The file of each of `some` rows, no two alike; none where files say nothing of demonstrations."""
        names, ends = list(self.sizes), np.cumsum(list(self.sizes.values()))
        return [names[k] for k in np.searchsorted(ends, self.numbers(some), side="right").tolist()] if names else []

    def read(self, names: Iterable[str], steps: slice = slice(0, None)) -> pa.Table:
        """Some columns, no two alike, of some of the rows, or of all."""
        columns = list(dict.fromkeys(names))
        tables = [table for _, table, _ in self.tables(columns, steps.start, steps.stop)] if columns else []
        return pa.concat_tables(tables, promote_options="permissive") if tables else pa.table({})
