"""Folders, patterns and addresses of several files with the same columns."""

from __future__ import annotations

import glob
import itertools
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path, PurePath, PurePosixPath

from pyarrow import fs

from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_exists
from rpil.data.folders import check_folder, check_inside, is_hidden
from rpil.data.guard import guarded, in_words
from rpil.data.json_files import LARGEST_METADATA
from rpil.data.names import OWN_TABLES
from rpil.formats import csv, parquet
from rpil.formats.columns import ColumnOptions
from rpil.formats.dialect import TEXT_SUFFIXES
from rpil.formats.format import Format, StepTables
from rpil.formats.meta_folder import choose_files

_MAY_BE_DATA = (".npz", ".npy", ".hdf5", ".h5", ".jsonl", ".ndjson", ".mat")

_REFUSED = {
    (".mcap", ".bag", ".db3"): ("recording of ROS or MCAP", "choose one rate, and write a table or a LeRobot folder"),
    (".tfrecord",): ("data set of RLDS or TFDS", "convert it to LeRobot with openx2lerobot of any4lerobot"),
    (".pkl", ".pickle"): (
        "pickle",
        "it can run any code: write a frame with df.to_parquet, trajectories with imitation",
    ),
    (".xlsx", ".xls", ".ods"): ("workbook", "export its table as CSV or Parquet"),
}
"""Parts of the names of files that are not read, what they are, and what to do."""


def read(path: StrPath, options: ColumnOptions) -> StepTables:
    """The recording in the Parquet files of a folder, or else in its text tables.

    A .txt file may be any text, as a licence: it is read where no file has another ending of a table.
    """
    filesystem, parquet_files, texts = find_files(path)
    text_files = [] if parquet_files else [one for one in texts if Path(one).name not in OWN_TABLES]
    text_files = [one for one in text_files if not one.lower().endswith((".txt", ".txt.gz"))] or text_files
    arrays = [str(one) for one in sorted(Path(path).glob("*")) if one.suffix.lower() in _MAY_BE_DATA]
    others = [Path(one).name for one in (*texts, *arrays) if one not in {*text_files}]
    source = Path(str(path)).name or str(path)
    for inner in (*Path(path).glob("*/meta/info.json"), *Path(path).glob("*/*/meta/info.json")):
        raise DataError(f"{path}: in it is a folder of LeRobot, which is read alone; give {inner.parents[1]}.")
    for about in (Path(path, "metadata.json"), Path(path, "data", "metadata.json")):
        if about.is_file() and about.stat().st_size < LARGEST_METADATA and b'"data_format"' in about.read_bytes():
            call = "rpil.read(minari.load_dataset(NAME).iterate_episodes())"
            raise DataError(f"{path}: it is a data set of Minari; read it in Python, by {call}.")
    if Path(path).name == "meta" and Path(path, "info.json").is_file():
        raise DataError(f"{path}: it describes a folder of LeRobot; give that one, {Path(path).absolute().parent}.")
    if not parquet_files and not text_files:
        refuse_others(path, os.listdir(path) if os.path.isdir(path) else ())
        but = f", and {others[0]} is no table of steps" if others else ""
        raise DataError(f"{path}: no .parquet or .csv file is there{but}; check the path.")
    beside = dict.fromkeys(others, f"not read beside {'Parquet files' if parquet_files else 'text tables'}")
    if not parquet_files:
        found = csv.read_files([Path(file) for file in text_files], options, source, csv.FILE)
    else:
        found = parquet.read_files(filesystem, parquet_files, options, source)
    return replace(found, ignored=beside)


def has_tables(path: StrPath) -> bool:
    """Whether a folder has Parquet files, or text tables but those of rpil: a .txt file may be any text."""
    _, _, files, texts = _listed(path)
    tables = (text for text in texts if PurePath(text).name not in OWN_TABLES)
    return bool(files) or not all(text.lower().endswith((".txt", ".txt.gz")) for text in tables)


def find_files(path: StrPath) -> tuple[fs.FileSystem, list[str], list[str]]:
    """The file system, and the Parquet files and the text tables of a data set in the order of their names.

    Of LeRobot's files those that ``meta`` lists. A `DataError` where `path` does not exist or cannot be listed.
    """
    filesystem, folder, files, texts = _listed(path)
    return filesystem, choose_files(filesystem, str(path), folder, files) if folder else files, texts


def _listed(path: StrPath) -> tuple[fs.FileSystem, str, list[str], list[str]]:
    """The file system, the folder if it is one, and all Parquet files and text tables; none of them is opened."""
    where = str(path)
    if where.startswith(("http://", "https://")):
        raise DataError(f"{where}: addresses of the web are not read; download the file, and give its path.")
    with guarded(where, "it cannot be listed", "check the path"):
        try:
            if "://" in where:
                filesystem, place = fs.FileSystem.from_uri(where)
            else:
                filesystem, place = fs.LocalFileSystem(), os.path.abspath(where)
                if not os.path.exists(place) and glob.has_magic(place):
                    found = _tables(sorted(glob.glob(place, recursive=True)), place)
                    top = next(folder for folder in PurePath(place).parents if not glob.has_magic(str(folder)))
                    for one in itertools.chain(*found):
                        check_inside(one, top)
                    return filesystem, "", *found
                check_exists(where)
            if isinstance(filesystem, fs.LocalFileSystem):
                check_folder(place)
            kind = filesystem.get_file_info(place).type
            if kind == fs.FileType.NotFound:
                raise DataError(f"{where}: there is no such file or folder; check the path.")
            if kind == fs.FileType.File:
                return filesystem, "", *_tables([place], place)
            data = f"{place}/data"  # of LeRobot, which has tables of other things in meta
            place = data if filesystem.get_file_info(data).type == fs.FileType.Directory else place
            entries = filesystem.get_file_info(fs.FileSelector(place, recursive=True))
        except ImportError as error:
            reason = in_words(error)
            raise DataError(f"{where}: addresses of this kind need a package of their own ({reason}).") from error
        return filesystem, place, *_tables(sorted(i.path for i in entries if i.type == fs.FileType.File), place)


def _tables(paths: list[str], top: str) -> tuple[list[str], list[str]]:
    """The Parquet files and the text tables among files, but for those in hidden folders of `top`."""
    shown = [p for p in paths if not PurePosixPath(p).name.startswith((".", "_"))]
    shown = [p for p in shown if not is_hidden(p.removeprefix(top).lstrip("/"))]
    return [p for p in shown if p.lower().endswith(".parquet")], [p for p in shown if p.lower().endswith(TEXT_SUFFIXES)]


def refuse_others(path: StrPath, names: Iterable[str]) -> None:
    """A `DataError` with the way to go where files are called as those of `_REFUSED`."""
    for name, (parts, (what, way)) in itertools.product(names, _REFUSED.items()):
        if any(part in name.lower() for part in parts):
            raise DataError(f"{path}: a {what} ({name}) is never opened; {way}.")


FORMAT = Format(name="a folder of tables", claims=Path.is_dir, read=read)
