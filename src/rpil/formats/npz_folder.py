"""A folder of NPZ files with a demonstration in each, in the folder itself or each in a folder of its own."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.files import new_folder
from rpil.data.folders import copy_folder, is_hidden
from rpil.data.guard import guarded
from rpil.data.json_files import Parsed, read_json
from rpil.data.names import ACTION, ACTION_COLUMNS, EPISODE, TASK, may_be_outcome, natural_key, plain_name
from rpil.data.npy import opened_npz
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, keep_by_own_ids, kept_of
from rpil.formats.step_arrays import Closed, Part, from_parts
from rpil.formats.step_tables import StepTables
from rpil.formats.store import find_files
from rpil.numerics.types import Array

_EPISODE_FILE = "name of the file"
_TEXT_BESIDE = "meta.json"
_TAKE_OUT = "write it again, or take it out of the folder"


def claims(path: Path) -> bool:
    """Whether `path` is a folder of NPZ files, and of no tables; texts may be notes."""
    if not path.is_dir() or not (any(path.glob("*.npz")) or any(path.glob("*/*.npz"))):
        return False
    tables = (file.lower() for files in find_files(path)[1:] for file in files)
    return all(file.endswith((".txt", ".txt.gz")) for file in tables) and bool(_files(path))


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read the arrays of every file; images are ignored. The files are opened again for their values."""
    files = _files(path)
    parts = [
        _part(name, file, file.parent / _TEXT_BESIDE if file.parent != path else None) for name, file in files.items()
    ]
    return from_parts(parts, _EPISODE_FILE, path.name, "NPZ, a file for each demonstration", options)


def keep(path: Path, output: Path, ids: Sequence[Id]) -> None:
    """Copy the files called `ids`, or the folders in which they lie, with all that is beside them, to a new folder."""
    files = _files(path)
    kept = [files[name] for name in kept_of(files, ids, path)]
    with new_folder(output) as folder:
        for file in kept:
            if file.parent != path:
                copy_folder(file.parent, folder / file.parent.name)
            else:
                (folder / file.name).write_bytes(file.read_bytes())


def _files(path: Path) -> dict[str, Path]:
    """The NPZ files by their names, or by those of the folders that hold one each; with the numbers in names in order.

    A `DataError` where one of these folders holds several.
    """
    found = {file.stem: file for file in _in_folder(path)}
    for folder in path.iterdir() if not found else ():
        inside = _in_folder(folder) if folder.is_dir() and not is_hidden(folder.name) else []
        if len(inside) > 1:
            raise DataError(
                f"{folder}: it holds {len(inside):,} NPZ files; give each demonstration a folder of its own."
            )
        found |= dict(zip([folder.name], inside, strict=False))
    return {name: found[name] for name in sorted(found, key=natural_key)}


def _in_folder(folder: Path) -> list[Path]:
    return [file for file in folder.glob("*.npz") if not is_hidden(file.name) and file.is_file()]


def _part(name: str, file: Path, about: Path | None) -> Part:
    """The demonstration in one file, whose one array of actions says how many steps it has."""
    where = f"{file.parent.name}/{file.name}"
    with opened_npz(file, where, _TAKE_OUT) as stored:
        arrays = {name: Closed(*stored.declared(name), partial(_rows, file, where, name)) for name in stored.names}
    actions = [array for array in arrays if plain_name(array) in ACTION and arrays[array].shape]
    actions += [array for array in arrays if ACTION_COLUMNS[1][0].fullmatch(plain_name(array)) and arrays[array].shape]
    if not actions:
        raise DataError(f"{where}: no array holds the actions of its steps; save one as {ACTION[1]!r}.")
    n_steps = arrays[actions[0]].shape[0]
    several = [one for one in arrays if plain_name(one) in EPISODE and arrays[one].shape[:1] == (n_steps,)]
    if several := several or ["indices"] * ({"acts", "indices", "terminal"} <= arrays.keys()):  # of imitation
        raise DataError(f"{where}: {several[0]!r} says that it holds several demonstrations; give its path alone.")
    singles = (one for one, array in arrays.items() if array.shape in ((), (1,)) and array.dtype.kind in "biuf")
    single = {one: np.asarray(arrays[one][:]).reshape(-1)[0] for one in singles if may_be_outcome(one)}
    said = {one: value for one, value in _said(about).items() if one not in single} if about else {}
    whole: dict[str, Id | float] = {_EPISODE_FILE: name, **said, **{one: value.item() for one, value in single.items()}}
    return Part(n_steps, {one: array for one, array in arrays.items() if one not in whole}, whole)


def _said(about: Path) -> dict[str, str | float]:
    """What the text beside a file says of the task and the outcome of its demonstration."""
    if not about.is_file():
        return {}
    with guarded(about, "no JSON, or damaged", "write it again"):
        found: Parsed = read_json(about)
    found = found if isinstance(found, dict) else {}
    tasks = {
        name: value for name, value in found.items() if TASK.fullmatch(plain_name(name)) and isinstance(value, str)
    }
    ends = {name: value for name, value in found.items() if may_be_outcome(name) and isinstance(value, int | float)}
    return {**tasks, **{name: float(value) for name, value in ends.items()}}


def _rows(file: Path, where: str, name: str, rows: slice) -> Array:
    """Some rows of an array in a file."""
    with opened_npz(file, where, _TAKE_OUT) as stored:
        values = stored.read([name])[name]
    return values[rows] if values.ndim else values


FORMAT = Format(
    name="NPZ, a file for each demonstration",
    claims=claims,
    read=read,
    keep=keep_by_own_ids(keep),
    check_output=lambda path, output: None,
)
