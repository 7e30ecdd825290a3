"""Reading a file of others in a process of its own: this process reads only the flat file that the other one wrote."""

from __future__ import annotations

import mmap
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.arrays import check_any
from rpil.data.held import holding
from rpil.data.json_files import Parsed
from rpil.formats.columns import ColumnOptions
from rpil.formats.import_process import in_child
from rpil.formats.recording import Recording, from_rows, from_tables
from rpil.formats.rows import Rows, TableRows
from rpil.formats.spool import fill, new_copy
from rpil.formats.step_tables import StepTables, from_facts
from rpil.formats.store import copied_rows

if TYPE_CHECKING:
    import pyarrow as pa


def imported(read: Callable[[], StepTables | Recording], path: Path, options: ColumnOptions) -> Recording:
    """The recording in the tables that `read` makes of the file or folder at `path`, in a process of its own.

    In memory they are in a file that has no name; on disk in a temporary one.
    """
    if sys.platform != "linux":
        with holding(alone=True):  # the tables are read later than the file is opened
            found = read()
            return found if isinstance(found, Recording) else from_tables(found, options.on_disk)
    import pyarrow as pa  # once, for both processes

    copy = new_copy(path.name) if options.on_disk else None
    file = os.memfd_create("steps")

    def work() -> Parsed:
        pa.set_memory_pool(pa.system_memory_pool())  # others may not go on after a fork
        tables = read()
        assert isinstance(tables, StepTables)
        if copy is not None:
            fill(copy, tables.tables, tables.origin.source)
        else:
            _write(tables, file)
        return tables.as_json()

    try:
        found = from_facts(in_child(work, str(path), size_of(path), options.memory))
        rows: Rows
        if copy is None:
            rows = TableRows(_mapped(file), found.origin.source, sizes=found.sizes)
        else:
            rows = copied_rows(copy, found.sizes)
    finally:
        os.close(file)
    return from_rows(rows, found.columns, found.origin)


def size_of(path: Path) -> float:
    """The bytes of a file, or of those in a folder."""
    if not path.is_dir():
        return path.stat().st_size
    return sum(os.lstat(os.path.join(top, name)).st_size for top, _, names in os.walk(path) for name in names)


def _write(found: StepTables, file: int) -> None:
    """Write all tables as one to an open file."""
    import pyarrow as pa

    whole = list(found.tables)
    check_any(len(whole), found.origin.source)
    table = pa.concat_tables(whole, promote_options="permissive")
    with os.fdopen(os.dup(file), "wb") as stream, pa.ipc.new_stream(stream, table.schema) as writer:
        writer.write_table(table)


def _mapped(file: int) -> pa.Table:
    """The table in an open file, mapped into memory; it stays when the file is closed."""
    import pyarrow as pa

    content = mmap.mmap(file, 0, access=mmap.ACCESS_READ)  # closed with the last column of it
    return pa.ipc.open_stream(pa.py_buffer(content)).read_all()
