"""The layout of an HDF5 file is found, and what none fits is refused."""

from __future__ import annotations

import pytest

import rpil
from hdf5_files import aloha, d4rl, h5py, robomimic
from rpil.data.errors import DataError
from rpil.formats.registry import find


def test_each_layout_is_found(tmp_path):
    made = {
        "HDF5 of robomimic's layout": robomimic(tmp_path / "a.hdf5"),
        "D4RL HDF5": d4rl(tmp_path / "b.hdf5"),
        "HDF5, a file for each demonstration": next(aloha(tmp_path / "c").glob("*.hdf5")),
    }
    for name, path in made.items():
        assert rpil.open(path).describe().format == name
        assert (find(path).unkept() == "") == ("robomimic" in name)


def test_a_file_of_no_layout_is_refused_with_what_is_in_it(tmp_path):
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        file["q"] = [1.0, 2.0]
    words = r"^x.hdf5: in this HDF5 file nothing says which steps are a demonstration \(it holds q \(2,\)\); write each"
    with pytest.raises(DataError, match=words):
        rpil.read(tmp_path / "x.hdf5")
    with pytest.raises(DataError, match=r"x\.hdf5: keep writes no HDF5 of this layout"):
        find(tmp_path / "x.hdf5").keep(tmp_path / "y.hdf5", [0])
    assert [file.name for file in tmp_path.iterdir()] == ["x.hdf5"]
