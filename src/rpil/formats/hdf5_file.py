"""HDF5 files, whatever their layout: the first one that fits reads the file, and keeps some of its demonstrations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.formats import array_folder, array_layout, hdf5, robomimic
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import commas
from rpil.formats.format import Format, Keep, StepTables, kept_of

if TYPE_CHECKING:
    import h5py


class Hdf5Layout(NamedTuple):
    """A layout of HDF5 files: whether one fits, and functions as those of a `Format`."""

    fits: Callable[[h5py.File], bool]
    read: Callable[[Path, ColumnOptions], StepTables]
    keep: Keep


def _read_rows(path: Path, options: ColumnOptions) -> StepTables:
    """Read the arrays that have a value for each action, and split them into demonstrations."""
    with hdf5.opened(path) as file:
        found = hdf5.Arrays(file)
        stacked = array_layout.is_stacked(found)
        name = "HDF5, a first index for each demonstration" if stacked else "D4RL HDF5"
        return array_layout.read_arrays(found, path.name, name, options, found.notes)


def _keep_rows(path: Path, output: Path, ids: Sequence[Id], options: ColumnOptions) -> None:
    """Write the steps of the demonstrations called `ids`, and all else of the file, to a new one.

    Where it has no timeouts they are added, so that each demonstration ends where it does here.
    """
    with hdf5.copying(path, output) as (source, new):
        arrays = hdf5.Arrays(source)
        layout = array_layout.layout_of(arrays, path.name)
        kept = kept_of(layout.names, ids, path)
        hdf5.copy_arrays(arrays, new, lambda name, array: layout.kept_rows(array, kept))
        for name, values in layout.new_arrays(arrays, kept, path.name, False).items():
            if name in arrays:
                new[name][...] = values
            else:
                new[name] = values


HDF5_LAYOUTS = (
    Hdf5Layout(robomimic.fits, robomimic.read, robomimic.keep),
    Hdf5Layout(lambda file: array_layout.tells(hdf5.Arrays(file)), _read_rows, _keep_rows),
    Hdf5Layout(array_folder.fits, array_folder.read, array_folder.keep),
)


def read(path: Path, options: ColumnOptions) -> StepTables:
    """What the layout that fits reads; errors are those of `_fitting`."""
    with _fitting(path) as layout:
        return layout.read(path, options)


def keep(path: Path, output: Path, ids: Sequence[Id], options: ColumnOptions) -> None:
    """What the layout that fits keeps; errors are those of `_fitting`."""
    with _fitting(path) as layout:
        layout.keep(path, output, ids, options)


@contextmanager
def _fitting(path: Path) -> Iterator[Hdf5Layout]:
    """The layout of a file, which stays open; a `DataError` that says what is in a file that none fits."""
    with hdf5.opened(path) as file:
        layout = next((one for one in HDF5_LAYOUTS if one.fits(file)), None)
        if layout is None:
            found = hdf5.Arrays(file)
            arrays = commas([f"{name} {array.shape}" for name, array in found.items()]) or "no arrays"
            raise DataError(
                f"{path.name}: in this HDF5 file nothing says which steps are a demonstration (it holds {arrays}); "
                "write each as a group with the arrays actions and obs, or add terminals and timeouts, or an array "
                "episode_index."
            )
        yield layout


FORMAT = Format(
    name="HDF5",
    claims=hdf5.is_hdf5,
    read=read,
    keep=keep,
    has_own_ids=True,
    suffixes=hdf5.SUFFIXES,
    check_output=hdf5.check_output,
)
