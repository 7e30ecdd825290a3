"""Rows of formats other than Parquet on disk: copied once, in batches, to a temporary Parquet file.

Passes over Parquet take less time than decoding text, HDF5 or Zarr again in each of them, and need one way of reading
only. The file is removed when its rows are no longer needed, or when the process ends.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.arrays import check_any
from rpil.data.errors import DataError
from rpil.data.files import temporary_path
from rpil.formats.rows import BATCH_ROWS

if TYPE_CHECKING:
    import pyarrow as pa


class Copy:
    """A temporary file, called as the data, in a new `folder`; both are removed with the object, by its process."""

    def __init__(self, folder: Path, name: str) -> None:
        folder.mkdir(mode=0o700)  # an error where it is there: what others hold is never removed
        weakref.finalize(self, _remove, folder, os.getpid())
        own = Path(name).name  # "." has none, and ".." would be the folder of temporary files
        self.path = folder / (own if own.strip(".") else "rows")

    def __reduce__(self) -> tuple[type[Path], tuple[str]]:
        """Another process reads the file and never removes it."""
        return Path, (str(self.path),)


def _remove(folder: Path, process: int) -> None:
    if os.getpid() == process:  # and not a process that was forked from it
        shutil.rmtree(folder, ignore_errors=True)


def spool(tables: Iterable[pa.Table], name: str) -> Copy:
    """A temporary Parquet file called `name` with the rows of `tables`.

    A `DataError` where it cannot be written, where there are no tables, or where they have columns of other types.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    waiting = iter(tables)
    first = next(waiting, None)
    check_any(int(first is not None), name)
    assert first is not None
    with _writing(name):
        copy = Copy(temporary_path(Path(tempfile.gettempdir(), f"rpil-{getattr(os, 'getuid', int)()}")), name)
        writer = pq.ParquetWriter(copy.path, first.schema, compression="lz4", write_statistics=False)
    group: list[pa.Table] = []  # of rows, which are written together
    for table in chain([first], waiting):  # whose errors are those of the data
        try:
            group.append(table.cast(first.schema))
        except (pa.ArrowInvalid, ValueError) as error:
            raise DataError(
                f"{name}: a column holds values of other types further on; read it into memory with <option>.",
                "no_stream",
            ) from error
        if sum(map(len, group)) >= BATCH_ROWS:
            with _writing(name):
                writer.write_table(pa.concat_tables(group))
            group = []
    with _writing(name):
        writer.write_table(pa.concat_tables(group or [first.slice(0, 0)]))
        writer.close()
    return copy


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
