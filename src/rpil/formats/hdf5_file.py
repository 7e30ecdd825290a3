"""HDF5 files, whatever their layout: the first one that fits reads the file."""

from __future__ import annotations

from pathlib import Path

from rpil.data.errors import DataError
from rpil.formats import array_folder, array_layout, hdf5, robomimic
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import commas
from rpil.formats.format import Format, StepTables


def read(path: Path, options: ColumnOptions) -> StepTables:
    """What the first layout that fits reads; a `DataError` that says what is in a file that none fits."""
    with hdf5.opened(path) as file:
        if robomimic.fits(file):
            return robomimic.read(path, options)
        found = hdf5.Arrays(file)
        if array_layout.tells(found):
            stacked = array_layout.is_stacked(found)
            name = "HDF5, a first index for each demonstration" if stacked else "D4RL HDF5"
            return array_layout.read_arrays(found, path.name, name, options, found.notes)
        if array_folder.fits(file):
            return array_folder.read(path, options)
        arrays = commas([f"{name} {array.shape}" for name, array in found.items()]) or "no arrays"
        raise DataError(
            f"{path.name}: in this HDF5 file nothing says which steps are a demonstration (it holds {arrays}); write "
            "each as a group with the arrays actions and obs, or add terminals and timeouts, or an array episode_index."
        )


def unkept(path: Path, options: ColumnOptions) -> str:
    """What `keep` writes no new file of, in words: all layouts but a group for each demonstration."""
    with hdf5.opened(path) as file:
        return "" if robomimic.fits(file) else "HDF5 of this layout"


FORMAT = Format(
    name="HDF5",
    claims=hdf5.is_hdf5,
    read=read,
    keep=robomimic.keep,
    unkept=unkept,
    has_own_ids=True,
    suffixes=hdf5.SUFFIXES,
)
