"""HDF5 with all steps in one row of arrays, as D4RL has them, or with a first index for demonstrations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import Id
from rpil.data.names import EPISODE, is_outcome
from rpil.formats import array_layout, hdf5
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import kept_of
from rpil.formats.step_tables import StepTables
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import h5py

_ROWS_AT_ONCE = 65_536


def fits(file: h5py.File) -> bool:
    """Whether actions are at the top of the file, beside what says which steps are a demonstration."""
    arrays = hdf5.Arrays(file)
    has_ids = array_layout.first(arrays, array_layout.ACTIONS) and array_layout.first(arrays, EPISODE)
    return bool(has_ids) or array_layout.tells(arrays)


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read the arrays that have a value for each action, and split them into demonstrations."""
    with hdf5.opened(path) as file:
        found = hdf5.contents(file, options.fill_missing)
        stacked = array_layout.is_stacked(found.arrays)
        name = "HDF5, a first index for each demonstration" if stacked else "D4RL HDF5"
        return array_layout.read_arrays(found.arrays, path.name, name, options, found.notes)


def keep(path: Path, output: Path, ids: Sequence[Id], options: ColumnOptions) -> None:
    """Write the steps of the demonstrations called `ids`, and all else of the file, to a new one.

    Where it has no timeouts they are added, so that each demonstration ends where it does here.
    """
    with hdf5.copying(path, output) as (source, new):
        found = hdf5.contents(source, options.fill_missing)
        arrays, layout = found.arrays, array_layout.layout_of(found.arrays, path.name)
        kept = kept_of(layout.names, ids, path)
        for name, group in found.groups.items():
            hdf5.copy_attributes(group, new.create_group(name))
        for name, array in arrays.items():
            if (rows := layout.kept_rows(array, kept)) is not None:
                # Rewards may be left out as zeros.
                _copy_rows(source[name] if is_outcome(name) else array, new, name, rows)
            else:
                source.copy(array, new, name)
        for name, values in layout.added_ends(arrays, kept, path.name).items():
            new[name] = values


def _copy_rows(array: h5py.Dataset, new: h5py.Group, name: str, rows: Array) -> None:
    """Write the `rows` of an array to a new one with the same compression, some at a time."""
    shape = (len(rows), *array.shape[1:])
    packed = array.chunks is not None and math.prod(shape) > 0
    how = {"compression": array.compression, "compression_opts": array.compression_opts, "shuffle": array.shuffle}
    chunks = {"chunks": tuple(map(min, array.chunks, shape)), **how} if packed else {}
    copy = new.create_dataset(name, shape, array.dtype, **chunks)
    hdf5.copy_attributes(array, copy)
    for run in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) != 1) + 1):
        for first in range(0, len(run), _ROWS_AT_ONCE):
            block = run[first : first + _ROWS_AT_ONCE]
            copy[block[0] : block[-1] + 1] = array[rows[block[0]] : rows[block[-1]] + 1]
