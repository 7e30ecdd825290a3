"""Folders, patterns and addresses of several files with the same columns."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal

from rpil.data.errors import DataError
from rpil.data.files import StrPath, new_folder
from rpil.formats import csv, parquet
from rpil.formats.columns import ColumnOptions
from rpil.formats.dialect import without_suffix
from rpil.formats.format import Format, StepTables, check_found
from rpil.formats.places import Cuts
from rpil.formats.store import find_files, has_parquet


def read(path: StrPath, options: ColumnOptions) -> StepTables:
    """The recording in the Parquet files of a folder, or else in its text tables."""
    filesystem, parquet_files, text_files = find_files(path)
    source = Path(str(path)).name or str(path)
    for inner in (*Path(path).glob("*/meta/info.json"), *Path(path).glob("*/*/meta/info.json")):
        raise DataError(f"{path}: in it is a folder of LeRobot, which is read alone; give {inner.parents[1]}.")
    if not parquet_files and not text_files:
        refuse_others(path, os.listdir(path) if os.path.isdir(path) else ())
        raise DataError(f"{path}: no .parquet or .csv file is there; check the path.")
    if not parquet_files:
        return csv.read_folder([Path(file) for file in text_files], options, source)
    beside = {Path(file).name: "a text table beside Parquet files" for file in text_files}
    return parquet.read_files(filesystem, parquet_files, options, source).with_ignored(beside)


def tables_of(path: StrPath) -> Literal["Parquet", "text"]:
    """The kind of the tables that are read."""
    return "Parquet" if has_parquet(path) else "text"


def refuse_others(path: StrPath, names: Iterable[str]) -> None:
    """A `DataError` with the way to go where files are called as recordings of ROS, or as data sets of RLDS are."""
    for name in names:
        if name.lower().endswith((".mcap", ".bag", ".db3")):
            way = (
                "its topics come at rates of their own: choose one rate, and write a table or a LeRobot folder with it"
            )
            raise DataError(f"{path}: a recording of ROS or MCAP ({name}) is not read, because {way}.")
        if ".tfrecord" in name.lower():
            way = "convert it to LeRobot with openx2lerobot of any4lerobot, then audit the new folder"
            raise DataError(f"{path}: a data set of RLDS or TFDS ({name}) is not read; {way}.")


def keep(path: Path, output: Path, ids: Sequence[object], options: ColumnOptions, cuts: Cuts) -> None:
    """Write the demonstrations `ids` of a folder to the new folder `output`, in files of the same names.

    Files of other demonstrations are left out, and so is all that is not read.
    """
    parquet_files, text_files = find_files(path)[1:]
    files = [Path(file) for file in parquet_files or text_files]
    if not files:
        raise DataError(f"{path}: no .parquet or .csv file is there; check the path.")
    wanted, found = set(map(str, ids)), set()
    with new_folder(output) as folder:
        for name, file in csv.names_in_folder(files).items():
            target = folder / file.relative_to(os.path.abspath(path))
            target.parent.mkdir(parents=True, exist_ok=True)
            if parquet_files:
                in_file = parquet.keep_rows(file, target, wanted, options, cuts)
            else:
                in_file = csv.keep_text(file, target, wanted, options, cuts, without_suffix(name))
            if not in_file:
                target.unlink(missing_ok=True)
            found |= in_file
        check_found(wanted, found, path)


FORMAT = Format(
    name="a folder of tables",
    claims=Path.is_dir,
    read=read,
    keep=keep,
    read_address=read,
    tables=tables_of,
)
