"""Demonstrations in Parquet files that stay on disk."""

from __future__ import annotations

from pathlib import Path

from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.guard import guard
from rpil.formats import parquet, spool
from rpil.formats.chosen import with_chosen
from rpil.formats.columns import ColumnOptions
from rpil.formats.dataset import Dataset
from rpil.formats.rows import BATCH_ROWS
from rpil.formats.store import find_files


@guard
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
    filesystem, paths, _ = find_files(path)
    if not paths:
        raise DataError(
            f"{path}: no .parquet file is there; other formats stay on disk by rpil.open(path, on_disk=True), or use "
            "rpil convert."
        )
    with spool.on_disk():
        recording = parquet.read_files(filesystem, paths, options, Path(str(path)).name or str(path), batch_rows)
        data = with_chosen(recording, options).demonstrations
    assert isinstance(data, Dataset)
    return data
