"""An array of HDF5 is read only where the file holds all its values."""

import pytest

import rpil
from hdf5_files import d4rl, h5py
from rpil.data.errors import DataError
from rpil.data.missing import fill_chunks
from rpil.formats import hdf5
from rpil.formats.registry import find


@pytest.mark.parametrize("how", [{}, {"chunks": (5, 2)}, {"chunks": (5, 2), "compression": "gzip"}])
def test_what_was_not_written_is_filled_in_where_that_is_asked_for(tmp_path, how):
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        array = file.create_dataset("x", (20, 2), "f4", fillvalue=7, **how)
        if how:
            array[5:10] = 1
    with hdf5.opened(tmp_path / "x.hdf5") as file:
        array = hdf5.array_at(file, "x")
        with fill_chunks():
            assert array[:].sum() == (20 * 2 * 7 - 10 * 6 if how else 20 * 2 * 7)
        with pytest.raises(DataError, match=r"x\.hdf5: x .*fill_missing=True"):
            array[:]


def test_arrays_that_are_not_read_may_be_stored_in_any_way(tmp_path):
    """Of those that are read no value may be missing; rewards without one are given back as they are read."""
    path, kept = d4rl(tmp_path / "x.hdf5"), tmp_path / "kept.hdf5"
    with h5py.File(path, "r+") as file:
        n = len(file["rewards"])
        del file["rewards"]
        file.create_dataset("rewards", (n,), "f4", chunks=(5,))[:5] = 1
    assert len(rpil.read(path)) == 3
    with pytest.raises(DataError, match=r"x\.hdf5: rewards .* 1 of its 8 chunks are in .*fill_missing=True"):
        rpil.read(path, observations="rewards")
    find(path).keep(kept, [0, 2])
    with h5py.File(kept) as file:
        assert file["rewards"][:].tolist() == [1] * 5 + [0] * (len(file["rewards"]) - 5)


def test_timeouts_that_were_not_written_are_all_false_where_that_is_asked_for(tmp_path):
    path = d4rl(tmp_path / "x.hdf5", terminal=(0, 1, 2), timeouts=False)
    with h5py.File(path, "r+") as file:
        file.create_dataset("timeouts", (36,), bool)
    with pytest.raises(DataError, match=r"x\.hdf5: timeouts .*fill_missing=True"):
        rpil.read(path)
    assert len(rpil.read(path, fill_missing=True)) == 3
