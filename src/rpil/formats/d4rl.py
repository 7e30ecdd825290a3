"""HDF5 with all steps in one row of arrays, as D4RL has them: demonstrations end at terminals and timeouts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.id_values import check_ids
from rpil.data.missing import are_chunks_filled, fill_chunks
from rpil.data.names import EPISODE, is_outcome
from rpil.formats import hdf5
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, keep_by_own_ids
from rpil.formats.step_arrays import NUMBERED, Part, StoredArray, from_parts
from rpil.formats.step_tables import StepTables
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import h5py

_TERMINALS, _TIMEOUTS, _NEXT = "terminals", "timeouts", "next_observations"
_ROWS_AT_ONCE = 65_536  # at a time


def claims(path: Path) -> bool:
    """Whether actions are at the top of the file, beside terminals, timeouts or ids of demonstrations."""
    return hdf5.has_layout(path, _fits)


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read the arrays that have a value for each action, and split them into demonstrations."""
    with hdf5.opened(path) as file:
        found = hdf5.contents(file)
        arrays: dict[str, StoredArray] = dict(found.arrays)
        column, notes = options.id, found.notes
        if column is None:
            column, ids, note = _ids(file, path.name)
            arrays.setdefault(column, ids)
            notes = (*notes, note)
        return from_parts([Part(_n_steps(file), arrays)], column, path.name, "D4RL HDF5", options, notes=notes)


def keep(path: Path, output: Path, ids: Sequence[Id]) -> None:
    """Write the steps of the demonstrations called `ids`, and all else of the file, to a new one.

    Where it has no timeouts they are added, so that each demonstration ends where it does here.
    """
    with hdf5.copying(path, output) as (source, new):
        values = _ids(source, path.name)[1]
        check_ids(ids, dict.fromkeys(values.tolist()), path.name, "the ids")
        rows = np.flatnonzero(np.isin(values, [int(i) for i in ids]))
        for name, array in hdf5.contents(source).arrays.items():
            folder = name.rpartition("/")[0]
            if folder and folder not in new:
                hdf5.copy_attributes(source[folder], new.create_group(folder))
            if array.shape[:1] == values.shape:
                _copy_rows(array, new, name, rows)
            else:
                source.copy(array, new, name)
        if _TIMEOUTS not in new:
            is_last = np.append(values[1:] != values[:-1], True)
            new[_TIMEOUTS] = (is_last & ~_flags(source, _TERMINALS, path.name))[rows]


def check_one(file: h5py.File, source: str) -> None:
    """A `DataError` where a file that stands for one demonstration holds several."""
    ends = _flags(file, _TERMINALS, source) | _flags(file, _TIMEOUTS, source)
    if ends[:-1].any():
        raise DataError(
            f"{source}: in a folder each file is one demonstration, and here {_TERMINALS} and {_TIMEOUTS} tell of "
            "several; give the path of the file alone."
        )


def _fits(file: h5py.File) -> bool:
    has_actions = hdf5.first_array(file, hdf5.ACTIONS) is not None
    return has_actions and hdf5.first_array(file, (_TERMINALS, _TIMEOUTS, _NEXT, *EPISODE)) is not None


def _n_steps(file: h5py.File) -> int:
    actions = hdf5.first_array(file, hdf5.ACTIONS)
    return 0 if actions is None else int(actions.shape[0])


def _ids(file: h5py.File, source: str) -> tuple[str, Array, str]:
    """The name of the column of ids, the ids (N,), which are whole numbers, and where they come from in words."""
    named = hdf5.first_array(file, EPISODE)
    if named is not None and named.shape == (_n_steps(file),) and named.dtype.kind in "iu":
        name = str(named.name).strip("/")
        return name, hdf5.load(named, source), f"Demonstrations by the array {name}."
    ends, words = _ends(file, source)
    return NUMBERED, np.concatenate([[0], np.cumsum(ends[:-1])]), words


def _ends(file: h5py.File, source: str) -> tuple[Array, str]:
    """Whether a demonstration ends at each step (N,), and how that was told, in words."""
    terminals, timeouts = (_flags(file, name, source) for name in (_TERMINALS, _TIMEOUTS))
    ends = terminals | timeouts
    if hdf5.first_array(file, (_TIMEOUTS,)) is not None:
        return ends, "Demonstrations end at terminals and timeouts."
    jumps = _jumps(file, source)
    if jumps is not None:
        return ends | jumps, (
            "There are no timeouts: demonstrations end at terminals, and where next_observations is not the following "
            "observation."
        )
    if not ends[:-1].any():
        raise DataError(
            f"{source}: nothing says where demonstrations begin (there are no timeouts, no next_observations, and no "
            "terminals before the last step); add an array timeouts, or one called episode_index."
        )
    return ends, (
        "There are no timeouts and no next_observations: demonstrations end at terminals alone, and one that was cut "
        "short is joined to the next."
    )


def _flags(file: h5py.File, name: str, source: str) -> Array:
    """An array of true and false (N,); all false where there is none."""
    n_steps, array = _n_steps(file), hdf5.first_array(file, (name,))
    if array is None:
        return np.zeros(n_steps, bool)
    if array.size != n_steps or array.shape[0] != n_steps or array.dtype.kind not in "biuf":
        raise DataError(
            f"{source}: {name} has the shape {array.shape} and the type {array.dtype} for {n_steps:,} actions; write "
            "one 0 or 1 for each."
        )
    return np.asarray(hdf5.load(array, source).reshape(-1) != 0)


def _jumps(file: h5py.File, source: str) -> Array | None:
    """Whether the step after each of the N begins anew; None where no array tells.

    Steps whose order was shuffled begin anew nearly everywhere: a `DataError`.
    """
    following = hdf5.first_array(file, (_NEXT,))
    observations = hdf5.first_array(file, ("observations",))
    if following is None or observations is None:
        return None
    n_steps = _n_steps(file)
    if (
        following.shape != observations.shape
        or observations.shape[0] != n_steps
        or observations.dtype.kind not in "biuf"
    ):
        raise DataError(
            f"{source}: {_NEXT} has the shape {following.shape} and observations {observations.shape} for {n_steps:,} "
            "actions; write both for every step."
        )
    differs = hdf5.load(following, source)[:-1] != hdf5.load(observations, source)[1:]
    jumps = np.append(differs.reshape(n_steps - 1, -1).any(axis=1), False)
    if 2 * jumps.sum() > n_steps:
        raise DataError(
            f"{source}: after {jumps.sum():,} of {n_steps:,} steps, {_NEXT} is not the following observation, so that "
            "the order of the steps was lost; use the file before it was shuffled, or add timeouts."
        )
    return np.asarray(jumps)


def _copy_rows(array: h5py.Dataset, new: h5py.Group, name: str, rows: Array) -> None:
    """Write the `rows` of an array to a new one with the same compression, some at a time."""
    shape = (len(rows), *array.shape[1:])
    packed = array.chunks is not None and math.prod(shape) > 0
    how = {"compression": array.compression, "compression_opts": array.compression_opts, "shuffle": array.shuffle}
    chunks = {"chunks": tuple(map(min, array.chunks, shape)), **how} if packed else {}
    copy = new.create_dataset(name, shape, array.dtype, **chunks)
    for key, value in array.attrs.items():
        copy.attrs[key] = value
    for run in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) != 1) + 1):
        for first in range(0, len(run), _ROWS_AT_ONCE):
            block = run[first : first + _ROWS_AT_ONCE]
            with fill_chunks(are_chunks_filled() or is_outcome(name)):  # rewards may be left out as zeros
                copy[block[0] : block[-1] + 1] = array[rows[block[0]] : rows[block[-1]] + 1]


FORMAT = Format(
    name="HDF5 of D4RL", claims=claims, read=read, keep=keep_by_own_ids(keep), check_output=hdf5.check_output
)
