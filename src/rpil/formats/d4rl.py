"""HDF5 with all steps in one row of arrays, as D4RL has them, or with a first index for demonstrations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.arrays import Id
from rpil.data.names import EPISODE
from rpil.formats import array_layout, hdf5
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import kept_of
from rpil.formats.places import Cuts
from rpil.formats.step_tables import StepTables

if TYPE_CHECKING:
    import h5py


def fits(file: h5py.File) -> bool:
    """Whether actions are at the top of the file, beside what says which steps are a demonstration."""
    arrays = hdf5.Arrays(file)
    has_ids = array_layout.first(arrays, array_layout.ACTIONS) and array_layout.first(arrays, EPISODE)
    return bool(has_ids) or array_layout.tells(arrays)


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read the arrays that have a value for each action, and split them into demonstrations."""
    with hdf5.opened(path) as file:
        found = hdf5.Arrays(file, options.fill_missing)
        stacked = array_layout.is_stacked(found)
        name = "HDF5, a first index for each demonstration" if stacked else "D4RL HDF5"
        return array_layout.read_arrays(found, path.name, name, options, found.notes)


def keep(path: Path, output: Path, ids: Sequence[Id], options: ColumnOptions, cuts: Cuts) -> None:
    """Write the steps of the demonstrations called `ids`, and all else of the file, to a new one.

    Where it has no timeouts they are added, so that each demonstration ends where it does here.
    """
    with hdf5.copying(path, output) as (source, new):
        arrays = hdf5.Arrays(source, options.fill_missing)
        layout = array_layout.layout_of(arrays, path.name)
        kept = kept_of(layout.names, ids, path)
        hdf5.copy_arrays(arrays, new, lambda name, array: layout.kept_rows(name, array, kept, cuts))
        for name in arrays:
            layout.cut_stacked(name, new[name], kept, cuts)
        for name, values in layout.new_arrays(arrays, kept, cuts, path.name).items():
            if name in arrays:
                new[name][...] = values
            else:
                new[name] = values
