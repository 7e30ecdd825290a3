"""Folders, patterns and addresses of several files with the same columns."""

from __future__ import annotations

from pathlib import Path

from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.formats import csv, parquet
from rpil.formats.columns import ColumnOptions
from rpil.formats.recording import Recording
from rpil.formats.store import find_files


def read(path: StrPath, options: ColumnOptions) -> Recording:
    """The recording in the Parquet files of a folder, or else in its text tables."""
    filesystem, parquet_files, text_files = find_files(path)
    source = Path(str(path)).name or str(path)
    if not parquet_files and not text_files:
        raise DataError(f"{path}: no .parquet or .csv file is there; check the path.")
    if not parquet_files:
        return csv.read_folder([Path(file) for file in text_files], options, source)
    recording = parquet.read_files(filesystem, parquet_files, options, source)
    return recording.with_ignored_files(text_files)
