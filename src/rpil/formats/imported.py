"""Reading a file of others in a process of its own.

This process reads only the flat file that the other one wrote, or Parquet files that the other one has read through.
"""

from __future__ import annotations

import mmap
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.held import holding
from rpil.data.json_files import Parsed
from rpil.data.memory import MIB
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import StepTables, from_facts
from rpil.formats.import_process import in_child
from rpil.formats.parquet_file import input_file, read_table
from rpil.formats.recording import Recording, from_rows, from_tables
from rpil.formats.rows import TableRows
from rpil.formats.spool import fill, new_copy
from rpil.formats.store import copied_rows, size_of
from rpil.formats.table import end_to_end

if TYPE_CHECKING:
    import pyarrow as pa

_LARGEST_PAGE = 256 * MIB
"""Bytes of a part of a file that are decoded at once, and may be whatever the rows are."""


def imported(read: Callable[[], StepTables], path: StrPath, options: ColumnOptions, is_parquet: bool) -> Recording:
    """The recording in the tables that `read` makes of the file or folder at `path`, in a process of its own.

    In memory they are in a file that has no name; on disk in a temporary one, or where they are if they `is_parquet`.
    """
    if sys.platform != "linux":
        with holding(alone=True):  # the tables are read later than the file is opened
            return from_tables(read(), options.on_disk)
    import pyarrow.compute
    import pyarrow.parquet

    pyarrow.array([])  # which imports pandas; all of it once, for both processes
    stays = options.on_disk and is_parquet
    if stays:
        _hold_files(path)
    copy = new_copy(Path(path).name) if options.on_disk and not stays else None
    file = os.memfd_create("steps")

    def work() -> Parsed:
        before, found = _peak(), read()
        if copy is not None:
            fill(copy, found.tables, found.origin.source)
        else:
            tables, source = found.tables, found.origin.source
            n_bytes = max(one.nbytes for one in tables) if stays else _write(end_to_end([*tables], source), file)
            if is_parquet and _peak() - before > 4 * n_bytes + _LARGEST_PAGE:
                fault = "to decode a part of it takes far more memory than its rows"
                raise DataError(f"{source}: {fault}; it is damaged, or write it with smaller pages.")
        return found.as_json()

    try:
        facts = in_child(work, str(path), size_of(path), options.memory)
        found, rows = from_facts(facts), None if options.on_disk else _mapped(file)
    finally:
        os.close(file)
    if stays:
        found = read()
        if found.in_place is None or found.in_place.stamps != facts["stamps"]:
            raise DataError(f"{path}: it has changed while it was read; read it again.")
        return from_tables(found, on_disk=True)
    if copy is not None:
        return from_rows(copied_rows(copy, found.sizes), found)
    return from_rows(TableRows(rows, found.origin.source, sizes=found.sizes), found)


def _hold_files(folder: StrPath) -> None:
    """Open the Parquet files of a folder before the fork, so that both processes read what was opened once."""
    from pyarrow import fs

    for top, _, names in os.walk(os.path.abspath(folder)):
        for place in (Path(top, name) for name in sorted(names) if name.endswith(".parquet")):
            if not place.is_symlink():
                with input_file(fs.LocalFileSystem(), place):
                    pass


def imported_table(path: Path) -> pa.Table:
    """The rows of a Parquet file, which a process of its own reads; see `rpil.formats.parquet_file.read_table`."""
    if sys.platform != "linux":
        return read_table(path)
    file = os.memfd_create("rows")
    try:
        in_child(lambda: _write(read_table(path), file), str(path), size_of(path))
        return _mapped(file)
    finally:
        os.close(file)


def _peak() -> int:
    """The bytes of memory that this process has taken at most."""
    import resource  # of Unix

    kilobytes: int = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return 1024 * kilobytes


def _write(table: pa.Table, file: int) -> int:
    """Write a table to an open file; its bytes."""
    import pyarrow as pa

    with os.fdopen(os.dup(file), "wb") as stream, pa.ipc.new_stream(stream, table.schema) as writer:
        writer.write_table(table)
    return int(table.nbytes)


def _mapped(file: int) -> pa.Table:
    """The table in an open file, mapped into memory; it stays when the file is closed."""
    import pyarrow as pa

    content = mmap.mmap(file, 0, access=mmap.ACCESS_READ)  # closed with the last column of it
    return pa.ipc.open_stream(pa.py_buffer(content)).read_all()
