"""Rows of formats other than Parquet on disk: copied once, in batches, to a temporary Parquet file.

Passes over Parquet take less time than decoding text, HDF5 or Zarr again in each of them, and need one way of reading
only. The file is removed when the process ends.
"""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.errors import DataError

if TYPE_CHECKING:
    import pyarrow as pa

_wanted: ContextVar[bool] = ContextVar("rows are copied to disk", default=False)
_folders: list[tempfile.TemporaryDirectory[str]] = []
"""Removed when the process ends, as their finalizers are called then."""


@contextmanager
def on_disk(wanted: bool = True) -> Iterator[None]:
    """Within the block, and only if `wanted`, rows that are read go to disk instead of into memory."""
    token = _wanted.set(wanted)
    try:
        yield
    finally:
        _wanted.reset(token)


def is_on_disk() -> bool:
    """Whether rows that are read here go to disk."""
    return _wanted.get()


def spool(tables: Iterable[pa.Table], name: str) -> Path:
    """A temporary Parquet file called `name` with the rows of `tables`; a `DataError` where the disk is full."""
    import pyarrow.parquet as pq

    folder = tempfile.TemporaryDirectory(prefix="rpil-")
    _folders.append(folder)
    path, waiting = Path(folder.name) / Path(name).name, iter(tables)
    first = next(waiting)
    try:
        with pq.ParquetWriter(path, first.schema, compression="lz4", write_statistics=False) as writer:
            for table in chain([first], waiting):
                writer.write_table(table)
    except OSError as error:
        folder.cleanup()
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise DataError(
            f"{name}: no space is left in {tempfile.gettempdir()} for a copy of its rows; set TMPDIR to a folder with "
            "more, or read the data into memory."
        ) from error
    return path
