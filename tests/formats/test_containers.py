"""HDF5 files with links, arrays without values, and chunks that hold more than they declare."""

import sys
import zlib

import numpy as np
import pytest

import rpil
from hdf5_files import aloha, h5py, robomimic
from rpil import formats
from rpil.data.errors import DataError, MissingExtraError
from rpil.formats.containers import open_hdf5
from rpil.formats.registry import find


def test_no_other_file_is_opened(tmp_path):
    """Links, virtual and external arrays lead to other files; they are named and left out."""
    secret = tmp_path / "secret.hdf5"
    with h5py.File(secret, "w") as file:
        file["values"] = np.full((10, 1), 42.0)
    path = tmp_path / "lift.hdf5"
    robomimic(path)
    raw = tmp_path / "raw.bin"
    raw.write_bytes(np.full(10, 42.0).tobytes())
    virtual = h5py.VirtualLayout((10, 1), "f8")
    virtual[:] = h5py.VirtualSource(str(secret), "values", (10, 1))
    with h5py.File(path, "r+") as file:
        obs = file["data/demo_0/obs"]
        obs["linked"] = h5py.ExternalLink(str(secret), "values")
        obs["soft"] = h5py.SoftLink("/data/demo_0/obs/gripper")
        obs.create_virtual_dataset("virtual", virtual)
        obs.create_dataset("outside", (10, 1), "f8", external=[(str(raw), 0, 80)])
        file["data/demo_3"] = h5py.ExternalLink(str(secret), "/")
    recording = formats.read_recording(path)
    assert recording.demonstrations.ids == ("demo_0", "demo_2", "demo_10")
    assert set(recording.demonstrations.observation_names) == {"gripper", *(f"robot/eef_pos.{k}" for k in range(3))}
    for name in ("linked", "soft"):
        assert f"obs/{name}" in recording.description.notes[0]
    assert {"obs/virtual", "obs/outside"} <= {*recording.description.ignored}


def test_without_h5py_the_extra_is_named(tmp_path, monkeypatch):
    path, folder = robomimic(tmp_path / "lift.hdf5"), aloha(tmp_path / "cube")
    monkeypatch.setitem(sys.modules, "h5py", None)
    for place in (path, folder):
        with pytest.raises(MissingExtraError, match=r"hdf5 .*rpil\[hdf5\]"):
            formats.read(place)
    assert find(path).format.name == "arrays"


@pytest.mark.parametrize("how", [{}, {"chunks": (5, 2)}, {"chunks": (5, 2), "compression": "gzip"}])
def test_what_was_not_written_is_refused(tmp_path, how):
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        array = file.create_dataset("x", (20, 2), "f4", fillvalue=7, **how)
        if how:
            array[5:10] = 1
    _, found = open_hdf5(tmp_path / "x.hdf5")
    with pytest.raises(DataError, match=r"x\.hdf5: x .*write it again"):
        found.arrays["x"][:]


def test_chunks_that_hold_more_than_they_declare_are_not_decoded(tmp_path):
    path = tmp_path / "x.hdf5"
    with h5py.File(path, "w") as file:
        for k in range(2):
            file[f"data/demo_{k}/obs/x"] = np.ones((10, 3))
        file["data/demo_0/actions"] = np.ones((10, 3))
        how = {"chunks": (10, 3), "compression": "gzip"}
        array = file.create_dataset("data/demo_1/actions", (10, 3), "f8", **how)
        array.id.write_direct_chunk((0, 0), zlib.compress(bytes(10**7), 1))
    with pytest.raises(DataError, match=r"x\.hdf5: data/demo_1/actions: its chunks hold more than they declare; "):
        rpil.read(path)
    with h5py.File(path, "w") as file:
        file.create_dataset("x", data=np.ones((1000, 3)), chunks=(1000, 3))
    assert open_hdf5(path)[1].arrays["x"][:].all()


def test_circles_of_links_are_gone_through_once(tmp_path):
    path = tmp_path / "circles.hdf5"
    with h5py.File(path, "w") as file:
        for k in range(2):
            file[f"data/demo_{k}/obs/x"], file[f"data/demo_{k}/actions"] = np.ones((10, 3)), np.ones((10, 2))
        for k in range(40):
            group = file.require_group("/data/demo_0/obs/" + "deep/" * k)
            group["again"], group["same"] = file["data"], file["data/demo_0"]
        file["data/demo_2"] = file["data/demo_1"]
    recording = rpil.open(path)
    assert recording.ids == ("demo_0", "demo_1")
    assert recording.demonstrations.n_observations == 3
    assert "Left out, because they are links, or hold no actions: demo_2." in recording.description.notes
