"""HDF5 with a file for each demonstration, as ALOHA and ACT write them: a folder of ``episode_0.hdf5``, and so on."""

from __future__ import annotations

import csv
import re
import shutil
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from rpil.data.arrays import Id
from rpil.data.cells import to_cell
from rpil.data.errors import DataError
from rpil.data.files import new_folder
from rpil.data.names import natural_key
from rpil.formats import hdf5
from rpil.formats.array_layout import ACTIONS, is_several
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, keep_by_own_ids, kept_of
from rpil.formats.step_arrays import Closed, Part, from_parts
from rpil.formats.step_tables import StepTables

LINK_TABLE = "kept.csv"
"""The table in the kept folder that says what each file was called."""

_FILE_NAME = "name of the file"


def claims(path: Path) -> bool:
    """Whether `path` is a folder of HDF5 files, and of no tables, or one file of an action and a group observations."""
    if path.is_dir():
        names = {file.name.lower() for file in path.iterdir()} - {LINK_TABLE}
        return bool(_files(path)) and not any(name.endswith((".parquet", ".csv")) for name in names)
    return hdf5.has_layout(
        path, lambda file: hdf5.Arrays(file).first(ACTIONS) is not None and "observations" in hdf5.groups(file)
    )


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read the arrays of every file; images are ignored. The files are opened again for their values."""
    read = [_read_part(name, file) for name, file in _files(path).items()]
    notes = tuple(dict.fromkeys(note for _, of_file in read for note in of_file))
    format_name = "HDF5, a file for each demonstration"
    return from_parts([part for part, _ in read], _FILE_NAME, path.name, format_name, options, notes=notes)


def _read_part(name: str, path: Path) -> tuple[Part, tuple[str, ...]]:
    """The demonstration in one file, and notes."""
    with hdf5.opened(path) as file:
        actions = hdf5.Arrays(file).first(ACTIONS)
        if actions is None:
            raise DataError(
                f"{path.name}: it is no file of one demonstration, because it holds no array 'action'; take it out of "
                "the folder, or give its path alone."
            )
        found = hdf5.contents(file)
        if is_several(found.arrays, int(actions.shape[0]), path.name):
            raise DataError(
                f"{path.name}: in a folder each file is one demonstration, and here terminals and timeouts tell of "
                "several; give the path of the file alone."
            )
        arrays = {
            column: Closed(array.shape, array.dtype, partial(_rows, path, column), array.chunks)
            for column, array in found.arrays.items()
        }
        notes = ("Recorded in a simulation.",) if np.any(file.attrs.get("sim", False)) else ()
        return Part(int(actions.shape[0]), arrays, {_FILE_NAME: name}), (*notes, *found.notes)


def keep(path: Path, output: Path, ids: Sequence[Id]) -> None:
    """Make a new folder of the files called `ids`, and the table ``kept.csv`` of what each was called.

    A file gets a second name (a hard link), which takes no room; on another disk it is copied. ``episode_*.hdf5`` are
    numbered again from 0, because ACT reads as many files as it is told, by number.
    """
    files = _files(path)
    kept = [files[name] for name in kept_of(files, ids, path)]
    numbered = all(re.fullmatch(r"episode_\d+", name) for name in files)
    links = [f"episode_{k}{file.suffix}" if numbered else file.name for k, file in enumerate(kept)]
    with new_folder(output) as folder:
        for link, file in zip(links, kept, strict=True):
            _link_or_copy(file.resolve(), folder / link)
        with (folder / LINK_TABLE).open("w", newline="", encoding="utf-8") as text:
            rows = csv.writer(text, lineterminator="\n")
            rows.writerow(["link", "file"])
            rows.writerows([to_cell(link), to_cell(file.name)] for link, file in zip(links, kept, strict=True))


def _link_or_copy(file: Path, new: Path) -> None:
    try:
        new.hardlink_to(file)
    except OSError:  # on another disk, of another user, or where files have one name only
        shutil.copyfile(file, new)


def _files(path: Path) -> dict[str, Path]:
    """The HDF5 files by their names without the extension, with the numbers in names in order."""
    if path.is_file():
        return {path.stem: path}
    found = [file for file in path.iterdir() if file.suffix.lower() in hdf5.SUFFIXES and not file.name.startswith(".")]
    return {file.stem: file for file in sorted(found, key=lambda file: natural_key(file.name))}


def _rows(path: Path, name: str, rows: slice) -> object:
    """Some rows of an array in a file."""
    with hdf5.opened(path) as file:
        array = hdf5.array_at(file, name)
        if array is None:
            raise DataError(f"{path.name}: it has changed while it was read; read it again.")
        return array[rows]


FORMAT = Format(
    name="HDF5 of ALOHA", claims=claims, read=read, keep=keep_by_own_ids(keep), check_output=lambda path, output: None
)
