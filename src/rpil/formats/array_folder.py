"""A folder with a file of arrays for each demonstration: HDF5, as ALOHA and ACT write them, or NPZ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.errors import DataError
from rpil.data.folders import is_hidden
from rpil.data.guard import guarded
from rpil.data.json_files import Parsed, read_json
from rpil.data.names import ACTION_COLUMNS, OWN_TABLES, TASK, may_be_outcome, natural_key, plain_name
from rpil.data.npy import opened_npz
from rpil.formats import hdf5
from rpil.formats.array_layout import ACTIONS, first, holds_several
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import without_damaged
from rpil.formats.format import Format, StepTables
from rpil.formats.npz import arrays_of
from rpil.formats.step_arrays import Closed, Part, StoredArray, from_parts

if TYPE_CHECKING:
    import h5py

_LINK_TABLE = "kept.csv"
"""The table of names that rpil 0.2 wrote into a folder of HDF5 files that it kept."""

_FILE_NAME = "name of the file"
_TEXT_BESIDE = "meta.json"
_TABLES = (".parquet", ".csv", ".csv.gz", ".tsv", ".tsv.gz")
_NPZ_FILE = ".npz"


def claims(path: Path) -> bool:
    """Whether `path` is a folder of such files and of no tables."""
    if not path.is_dir():
        return False
    names = {file.name.lower() for pattern in ("*", "*/*") for file in path.glob(pattern)} - {_LINK_TABLE, *OWN_TABLES}
    return not any(name.endswith(_TABLES) for name in names) and bool(_files(path))


def fits(file: h5py.File) -> bool:
    """Whether a file has an array of actions beside a group of observations, as one of ALOHA has."""
    return first(hdf5.Arrays(file), ACTIONS) is not None and "observations" in hdf5.groups(file)


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read the arrays of every file; images are ignored. The files are opened again for their values."""
    files = _files(path)
    read, damaged = without_damaged(files, lambda name: _part(name, files[name], path), options.skip_bad)
    notes = tuple(dict.fromkeys(note for _, of_file in read.values() for note in of_file))
    format_name = f"{'NPZ' if _are_npz(files) else 'HDF5'}, a file for each demonstration"
    parts = [part for part, _ in read.values()]
    found = from_parts(parts, _FILE_NAME, path.name, format_name, options, notes=notes)
    return replace(found, origin=replace(found.origin, skipped=tuple(files[name].name for name in damaged)))


def _files(path: Path) -> dict[str, Path]:
    """The files by their names without the extension, with the numbers in names in order; HDF5 files come first.

    NPZ files may lie in a folder each, by whose names they are called; a `DataError` where one of these holds several.
    """
    if path.is_file():
        return {path.stem: path}
    files = _in_folder(path, hdf5.SUFFIXES) or _in_folder(path, (_NPZ_FILE,))
    found = {file.stem: file for file in files}
    if len(found) < len(files):
        again = next(file for file in files if file not in found.values())
        raise DataError(f"{again}: another file of the folder has this name and another extension; move one of them.")
    for folder in path.iterdir() if not found else ():
        inside = _in_folder(folder, (_NPZ_FILE,)) if folder.is_dir() and not is_hidden(folder.name) else []
        if len(inside) > 1:
            raise DataError(
                f"{folder}: it holds {len(inside):,} NPZ files; give each demonstration a folder of its own."
            )
        if inside:
            found[folder.name] = inside[0]
    return {name: found[name] for name in sorted(found, key=natural_key)}


def _in_folder(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    files = sorted(folder.iterdir(), key=lambda file: natural_key(file.name))
    return [file for file in files if file.suffix.lower() in suffixes and not is_hidden(file.name) and file.is_file()]


def _are_npz(files: Mapping[str, Path]) -> bool:
    return next(iter(files.values())).suffix.lower() == _NPZ_FILE


def _part(name: str, file: Path, top: Path) -> tuple[Part, tuple[str, ...]]:
    """The demonstration in one file, whose one array of actions says how many steps it has, and notes."""
    with _opened(file) as (where, arrays, notes):
        acted = [one for whole, _ in ACTION_COLUMNS[:2] for one in arrays if whole.fullmatch(plain_name(one))]
        actions = first(arrays, (*ACTIONS, *acted))
        if actions is None:
            raise DataError(
                f"{where}: in a folder each file is one demonstration, and here no array holds its actions; give the "
                f"path of the file itself, call the array {ACTIONS[0]!r}, or take the file out of the folder."
            )
        n_steps = arrays[actions].shape[0]
        if several := holds_several(arrays, n_steps, where):
            raise DataError(
                f"{where}: in a folder each file is one demonstration, and here {several} names several; give "
                "the path of the file itself."
            )
        numbers = [one for one, array in arrays.items() if array.shape in ((), (1,)) and array.dtype.kind in "biuf"]
        whole = {one: arrays[one] for one in numbers if may_be_outcome(one)}
        about = _text_beside(file.parent / _TEXT_BESIDE) if file.parent not in (top, top.parent) else {}
        about |= {one: np.asarray(array[...]).item() for one, array in whole.items()}  # type: ignore[index]
        closed = {
            one: Closed(array.shape, array.dtype, partial(_rows, file, one))
            for one, array in arrays.items()
            if one not in about or array.shape == (n_steps,)  # of one step
        }
        return Part(n_steps, closed, {_FILE_NAME: name, **about}), notes


@contextmanager
def _opened(file: Path) -> Iterator[tuple[str, Mapping[str, StoredArray], tuple[str, ...]]]:
    """What to call a file in messages, its arrays by name, and notes on it."""
    if file.suffix.lower() != _NPZ_FILE:
        with hdf5.opened(file) as stored:
            arrays = hdf5.Arrays(stored)
            notes = ("Recorded in a simulation.",) if np.any(stored.attrs.get("sim", False)) else ()
            yield file.name, arrays, (*notes, *arrays.notes)
        return
    where = f"{file.parent.name}/{file.name}"
    with opened_npz(file, where, "write it again, or take it out of the folder") as npz:
        yield where, arrays_of(npz), ()


def _rows(file: Path, name: str, rows: slice) -> object:
    """Some rows of an array in a file."""
    with _opened(file) as (where, arrays, _):
        if name not in arrays:
            raise DataError(f"{where}: it has changed while it was read; read it again.")
        return arrays[name][rows]


def _text_beside(path: Path) -> dict[str, str | float]:
    """What the text beside a file says of the task and the outcome of its demonstration."""
    if not path.is_file():
        return {}
    with guarded(path, "no JSON, or damaged", "write it again"):
        found: Parsed = read_json(path)
    found = found if isinstance(found, dict) else {}
    tasks = {
        name: value for name, value in found.items() if TASK.fullmatch(plain_name(name)) and isinstance(value, str)
    }
    ends = {name: value for name, value in found.items() if may_be_outcome(name) and isinstance(value, int | float)}
    return {**tasks, **{name: float(value) for name, value in ends.items()}}


FORMAT = Format(name="a file of arrays for each demonstration", claims=claims, read=read)
