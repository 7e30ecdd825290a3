"""Recordings in Parquet files that stay on disk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rpil.data.arrays import check_any
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.guard import guard
from rpil.formats.columns import ColumnOptions
from rpil.formats.dataset import Dataset
from rpil.formats.lerobot import format_name
from rpil.formats.recording import Recording, from_scan
from rpil.formats.rows import BATCH_ROWS
from rpil.formats.scan import scan
from rpil.formats.store import find_files, open_rows
from rpil.formats.table_facts import Origin


@guard
def open_recording(path: StrPath, options: ColumnOptions = ColumnOptions(), batch_rows: int = BATCH_ROWS) -> Recording:
    """The recording in Parquet files that stay on disk, which are read once here; see `open_dataset`."""
    filesystem, paths, text_files = find_files(path)
    if not paths:
        raise DataError(
            f"{path}: no .parquet file is there; only Parquet files make a data set on disk: read it into memory, or "
            "use rpil convert."
        )
    source = Path(str(path)).name or str(path)
    rows, columns, layout, metadata = open_rows(filesystem, paths, options)
    rows = replace(rows, batch_rows=batch_rows)
    check_any(len(rows.groups), source)
    found = scan(rows, layout, columns, source)
    recording = from_scan(rows, columns, found, Origin(source, metadata=metadata), format_name(metadata, len(paths)))
    return recording.with_ignored_files(text_files)


def open_dataset(path: StrPath, *, options: ColumnOptions = ColumnOptions(), batch_rows: int = BATCH_ROWS) -> Dataset:
    """Open demonstrations in Parquet files, which need not fit in memory.

    Parameters
    ----------
    path : path
        A .parquet file; a folder of such files, with all folders in it (of LeRobot's, those in ``data``), taken in the
        order of their names; a pattern such as ``drive/*.parquet``; or an address that pyarrow knows, such as
        ``s3://bucket/folder``.
    options : ColumnOptions
        What each column holds, where its name does not say it.
    batch_rows : int
        Rows that are decoded at a time.

    Raises
    ------
    DataError
        One sentence: no files, files with different columns, missing values among the actions and ids, or a
        demonstration whose rows are not consecutive, or not in the order of their column.
    """
    data = open_recording(path, options, batch_rows).demonstrations
    assert isinstance(data, Dataset)
    return data
