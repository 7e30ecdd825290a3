"""An array of HDF5 is read only where the file holds what its shape declares."""

import zlib

import numpy as np
import pytest

import rpil
from hdf5_files import d4rl, h5py
from rpil.data.errors import DataError
from rpil.data.missing import fill_chunks
from rpil.formats import hdf5
from rpil.formats.registry import find

VALUES = np.arange(300.0).reshape(100, 3)
STORED = {
    "contiguous": {},
    "chunked": {"chunks": (7, 2)},
    "gzip": {"compression": "gzip"},
    "shuffle": {"compression": "gzip", "shuffle": True, "fletcher32": True, "chunks": (30, 3)},
    "lzf": {"compression": "lzf", "shuffle": True, "chunks": (30, 3)},
    "longer": {"compression": "gzip", "maxshape": (None, 3), "chunks": (4096, 3)},
}


def test_sound_arrays_are_read(tmp_path):
    noise = np.random.default_rng(0).bytes(300)
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        for name, how in STORED.items():
            file.create_dataset(name, data=VALUES, **how)
        file.create_dataset("noise", data=np.frombuffer(noise, np.uint8), compression="lzf", chunks=(300,))
        file.create_dataset("none", (0, 3), "f4")
        file.create_dataset("scalar", data=3.0)
        file["text"] = np.array([b"demo_0", b"demo_1"])
        of_chunk(VALUES[:10].tobytes(), filter_mask=1)(file)  # which is not compressed
    with hdf5.opened(tmp_path / "x.hdf5") as file:
        for name in STORED:
            np.testing.assert_array_equal(hdf5.array_at(file, name)[:], VALUES)
            np.testing.assert_array_equal(hdf5.array_at(file, name)[10:20], VALUES[10:20])
        assert hdf5.array_at(file, "noise")[:].tobytes() == noise
        assert hdf5.array_at(file, "none")[:].shape == (0, 3)
        assert hdf5.array_at(file, "scalar")[()] == 3
        np.testing.assert_array_equal(hdf5.array_at(file, "x")[:], VALUES[:10])
        assert hdf5.array_at(file, "text")[()].tolist() == [b"demo_0", b"demo_1"]


def unwritten(file):
    file.create_dataset("x", (100, 3), "f4")


def unwritten_chunks(file):
    file.create_dataset("x", (100, 3), "f4", chunks=(10, 3))


def of_chunk(content, filter_mask=0, **how):
    def write(file):
        array = file.create_dataset("x", (10, 3), "f8", **{"compression": "gzip", "chunks": (10, 3)} | how)
        array.id.write_direct_chunk((0, 0), content, filter_mask)

    return write


def large_chunks(file):
    file.create_dataset("x", data=VALUES[:10], chunks=(2 * 10**7, 1), maxshape=(None, 3), compression="gzip")


def some_chunks_unwritten(file):
    file.create_dataset("x", (100, 3), "f4", chunks=(10, 3))[10:50] = 1


HOSTILE = {
    "some chunks unwritten": some_chunks_unwritten,
    "unwritten": unwritten,
    "unwritten chunks": unwritten_chunks,
    "longer": of_chunk(zlib.compress(bytes(241))),
    "shorter": of_chunk(zlib.compress(bytes(239))),
    "no deflate": of_chunk(bytes(240)),
    "far longer": of_chunk(zlib.compress(bytes(10**6))),
    "longer, not compressed": of_chunk(bytes(300), filter_mask=1),
    "longer than lzf writes": of_chunk(bytes(300), compression="lzf"),
    "large chunks": large_chunks,
    "other filters": lambda file: file.create_dataset("x", data=np.arange(9), scaleoffset=4, chunks=(9,)),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_what_the_file_does_not_hold_is_refused(tmp_path, name):
    with h5py.File(tmp_path / "bad.hdf5", "w") as file:
        HOSTILE[name](file)
    with hdf5.opened(tmp_path / "bad.hdf5") as file, pytest.raises(DataError, match=r"^bad.hdf5: x[ :].*\.$"):
        hdf5.array_at(file, "x")[0:1]


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
    """Those that are read may not, and rewards without a value are given back as they are read."""
    path, kept = d4rl(tmp_path / "x.hdf5"), tmp_path / "kept.hdf5"
    with h5py.File(path, "r+") as file:
        n = len(file["rewards"])
        del file["rewards"]
        file.create_dataset("rewards", (n,), "f4", chunks=(5,))[:5] = 1
        file.create_dataset("infos/packed", data=np.arange(n), scaleoffset=8, chunks=(5,))
    assert len(rpil.read(path)) == 3
    with pytest.raises(DataError, match=r"x\.hdf5: rewards .* 1 of its 8 chunks are in .*fill_missing=True"):
        rpil.read(path, observations="rewards")
    with pytest.raises(DataError, match=r"infos/packed .*\(scaleoffset\)"):
        rpil.read(path, observations="infos/packed")
    with h5py.File(path, "r+") as file:
        del file["infos/packed"]
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


def test_texts_of_one_length_that_are_too_long_are_not_loaded(tmp_path):
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        file["x"] = np.array([b"a"], dtype="S5000")
    with hdf5.opened(tmp_path / "x.hdf5") as file, pytest.raises(DataError, match=r"x\.hdf5: x is of texts of 5,000"):
        hdf5.load(hdf5.array_at(file, "x"), "x.hdf5")
