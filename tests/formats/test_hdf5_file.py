"""The layout of an HDF5 file is found, and what none fits is refused."""

from __future__ import annotations

import pytest

import rpil
from hdf5_files import aloha, d4rl, h5py, robomimic
from rpil.data.errors import DataError
from rpil.formats.registry import find


def test_each_layout_is_found_and_kept_in_a_file(tmp_path):
    made = {
        "HDF5 of robomimic's layout": robomimic(tmp_path / "a.hdf5"),
        "D4RL HDF5": d4rl(tmp_path / "b.hdf5"),
        "HDF5, a file for each demonstration": next(aloha(tmp_path / "c").glob("*.hdf5")),
    }
    for name, path in made.items():
        recording = rpil.open(path)
        assert recording.describe().format == name
        output = tmp_path / f"kept of {path.name}"
        find(path).keep(output, recording.ids[:1])
        assert output.is_file()
        assert rpil.read(output).n_steps == recording.demonstrations.lengths[0]


def test_a_file_of_no_layout_is_refused_with_what_is_in_it(tmp_path):
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        file["q"] = [1.0, 2.0]
    words = r"^x.hdf5: in this HDF5 file nothing says which steps are a demonstration \(it holds q \(2,\)\); write each"
    for act in (rpil.read, lambda path: find(path).keep(tmp_path / "y.hdf5", [0])):
        with pytest.raises(DataError, match=words):
            act(tmp_path / "x.hdf5")
    assert [file.name for file in tmp_path.iterdir()] == ["x.hdf5"]
