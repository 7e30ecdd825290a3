"""Folders of several files with the same columns."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.memory import LARGEST_METADATA
from rpil.data.text import OWN_TABLES
from rpil.formats import csv, parquet
from rpil.formats.columns import FILE, ColumnOptions
from rpil.formats.csv import TEXT_SUFFIXES
from rpil.formats.format import Format, StepTables
from rpil.formats.parquet import MetaFolder

_MAY_BE_DATA = (".npz", ".npy", ".hdf5", ".h5", ".jsonl", ".ndjson", ".mat")

_PACKED = tuple(f"{suffix}.gz" for suffix in TEXT_SUFFIXES)
_REFUSED = {
    (".mcap", ".bag", ".db3"): ("recording of ROS or MCAP", "choose one rate, and write a table or a LeRobot folder"),
    (".tfrecord",): ("data set of RLDS or TFDS", "convert it to LeRobot with openx2lerobot of any4lerobot"),
    (".pkl", ".pickle"): ("pickle", "it can run any code: write a frame with df.to_parquet"),
    (".arrow", ".feather"): ("file of Arrow", "load it in Python, as with imitation.data.serialize.load"),
    (".xlsx", ".xls", ".ods"): ("workbook", "export its table as CSV or Parquet"),
    _PACKED: ("packed table", "unpack it with gunzip"),
}
"""Parts of the names of files that are not read, what they are, and what to do."""


def read(path: StrPath, options: ColumnOptions) -> StepTables:
    """The recording in the Parquet files of a folder, or else in its text tables.

    A .txt file may be any text, as a licence: it is read where no file has another ending of a table.
    """
    for about in (Path(path, "metadata.json"), Path(path, "data", "metadata.json")):
        if about.is_file() and about.stat().st_size < LARGEST_METADATA and b'"data_format"' in about.read_bytes():
            way, file = "rpil.read(minari.load_dataset(NAME).iterate_episodes())", about.with_name("main_data.hdf5")
            way += f", or give its file {file}" * file.is_file()
            raise DataError(f"{path}: it is a data set of Minari; read it in Python, by {way}.")
    parquet_files, texts = find_files(path)
    text_files = [] if parquet_files else [one for one in texts if one.name not in OWN_TABLES]
    text_files = [one for one in text_files if not one.name.lower().endswith((".txt", ".txt.gz"))] or text_files
    refuse_others(path, [one.name for one in text_files if one.name.lower().endswith(_PACKED)])
    arrays = (one for one in sorted(Path(path).glob("*")) if one.suffix.lower() in _MAY_BE_DATA)
    others = [one.name for one in (*texts, *arrays) if one not in text_files]
    if not parquet_files and "codebase_version" in (info := MetaFolder(Path(path)).info):
        n = str(info.get("total_episodes", "?"))[:20]
        said = f"meta/info.json describes a data set of LeRobot of {n} episodes, and no Parquet file is in data"
        raise DataError(f"{path}: {said}; download it again, or record some.")
    if not parquet_files and not text_files:
        refuse_others(path, os.listdir(path) if os.path.isdir(path) else ())
        but = f", and {others[0]} is no table of steps" if others else ""
        raise DataError(f"{path}: no .parquet or .csv file is there{but}; check the path.")
    source = Path(path).name or str(path)
    if parquet_files:
        found, kind = parquet.read_files([*map(str, parquet_files)], options, source), "Parquet files"
    else:
        found, kind = csv.read_files(text_files, options, source, FILE), "text tables"
    return replace(found, ignored=dict.fromkeys(others, f"not read beside {kind}"))


def has_tables(path: StrPath) -> bool:
    """Whether a folder has Parquet files, or text tables but those of rpil: a .txt file may be any text."""
    files, texts = find_files(path)
    tables = (text.name for text in texts if text.name not in OWN_TABLES)
    return bool(files) or not all(name.lower().endswith((".txt", ".txt.gz")) for name in tables)


def find_files(path: StrPath) -> tuple[list[Path], list[Path]]:
    """The Parquet files and the text tables of a data set in the order of their names; none of them is opened. A
    `DataError` where in `path` is a folder of LeRobot."""
    top = Path(os.path.abspath(path))
    for inner in (*top.glob("*/meta/info.json"), *top.glob("*/*/meta/info.json")):
        raise DataError(f"{path}: in it is a folder of LeRobot, which is read alone; give {inner.parents[1]}.")
    if top.name == "meta" and (top / "info.json").is_file():
        raise DataError(f"{path}: it describes a folder of LeRobot; give that one, {top.parent}.")
    top = top / "data" if (top / "data").is_dir() else top
    meta, found = str(top / "meta"), list[str]()  # of LeRobot, with tables of other things
    for folder, folders, files in os.walk(top):
        folders[:] = [name for name in folders if not (folder == str(top) and name.startswith("."))]
        found += [os.path.join(folder, m) for m in files if m[0] not in "._" and not folder.startswith(meta)]
    names = {Path(one): one.lower() for one in sorted(found)}
    texts = (*TEXT_SUFFIXES, *_PACKED)
    return [m for m in names if names[m].endswith(".parquet")], [m for m in names if names[m].endswith(texts)]


def refuse_others(path: StrPath, names: Iterable[str]) -> None:
    """A `DataError` with the way to go where files are called as those of `_REFUSED`."""
    for name, (parts, (what, way)) in itertools.product(names, _REFUSED.items()):
        if any(part in name.lower() for part in parts):
            raise DataError(f"{path}: a {what} ({name}) is never opened; {way}.")


FORMAT = Format(name="a folder of tables", claims=Path.is_dir, read=read)
