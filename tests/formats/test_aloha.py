import os

import numpy as np
import pytest

from hdf5_files import aloha, d4rl, h5py, robomimic
from rpil import formats
from rpil.data.errors import DataError
from rpil.formats.registry import find


def test_every_file_of_the_folder_is_a_demonstration(tmp_path):
    folder = aloha(tmp_path / "sim_transfer_cube", 11)
    (folder / "notes.txt").write_text("not read")
    recording = formats.read_recording(folder)
    demonstrations, about = recording.demonstrations, recording.description
    assert demonstrations.ids == tuple(f"episode_{k}" for k in range(11))
    assert demonstrations.lengths.tolist() == [20 + k for k in range(11)]
    assert demonstrations.observation_names[14] == "qvel.0"
    with h5py.File(folder / "episode_10.hdf5") as file:
        expected = np.hstack([file["observations/qpos"][:], file["observations/qvel"][:]])
        np.testing.assert_array_equal(demonstrations.observations[-30:], expected)
        np.testing.assert_array_equal(demonstrations.actions[-30:], file["action"][:])
    assert set(about.ignored) == {"observations/images/top"}
    assert "simulation" in about.notes[0]


def test_a_file_of_several_demonstrations_is_not_read_as_one(tmp_path):
    d4rl(tmp_path / "walker.hdf5")
    with pytest.raises(DataError, match=r"walker.hdf5: in a folder each file is one demonstration"):
        formats.read(tmp_path)
    d4rl(tmp_path / "walker.hdf5", lengths=(20,), terminal=(0,))
    assert formats.read(tmp_path).ids == ("walker",)


def test_kept_files_are_numbered_from_zero(tmp_path, monkeypatch):
    folder, output = aloha(tmp_path / "cube", 11), tmp_path / "kept"
    find(folder).keep(output, ["episode_10", "episode_2"])
    assert (
        output / "kept.csv"
    ).read_text() == "link,file\nepisode_0.hdf5,episode_2.hdf5\nepisode_1.hdf5,episode_10.hdf5\n"
    assert (output / "episode_1.hdf5").samefile(folder / "episode_10.hdf5")  # which takes no room
    assert not (output / "episode_1.hdf5").is_symlink()
    again, first = formats.read(output), formats.read(folder).select([2, 10])
    assert again.ids == ("episode_0", "episode_1")
    np.testing.assert_array_equal(again.observations, first.observations)
    monkeypatch.setattr("pathlib.Path.hardlink_to", lambda *_: os.link("no", "where"))  # as to another disk
    find(folder).keep(tmp_path / "copied", ["episode_2"])
    assert (tmp_path / "copied" / "episode_0.hdf5").read_bytes() == (folder / "episode_2.hdf5").read_bytes()


def test_other_names_stay(tmp_path):
    folder = aloha(tmp_path / "cube")
    for file in list(folder.iterdir()):
        file.rename(folder / f"take_{file.name}")
    find(folder).keep(tmp_path / "kept", ["take_episode_2"])
    assert {file.name for file in (tmp_path / "kept").iterdir()} == {"take_episode_2.hdf5", "kept.csv"}


def test_a_file_of_another_layout_is_named(tmp_path):
    folder = aloha(tmp_path / "cube")
    robomimic(folder / "lift.hdf5")
    with pytest.raises(DataError, match=r"lift.hdf5: it is no file of one demonstration"):
        formats.read(folder)


def test_a_folder_of_tables_is_read_as_tables(tmp_path):
    folder = aloha(tmp_path / "cube")
    (folder / "steps.csv").write_text("episode,x,action\n1,0.5,0\n2,0.25,1\n")
    assert formats.read(folder).ids == (1, 2)
