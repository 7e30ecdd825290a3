"""A folder with a file for each demonstration, of HDF5 or NPZ."""

import json
import shutil

import numpy as np
import pytest

import rpil
import samples
from hdf5_files import aloha, h5py
from rpil import formats
from rpil.data.errors import DataError


def test_every_file_of_the_folder_is_a_demonstration(tmp_path):
    folder = aloha(tmp_path / "sim_transfer_cube", 11)
    (folder / "notes.txt").write_text("not read")
    recording = formats.read_recording(folder)
    demonstrations, about = recording.demonstrations, recording.description
    assert demonstrations.ids == tuple(f"episode_{k}" for k in range(11))
    assert (demonstrations.observation_names[14], [*demonstrations.lengths]) == ("qvel.0", [*range(20, 31)])
    with h5py.File(folder / "episode_10.hdf5") as file:
        expected = np.hstack([file["observations/qpos"][:], file["observations/qvel"][:]])
        np.testing.assert_array_equal(demonstrations.observations[-30:], expected)
        np.testing.assert_array_equal(demonstrations.actions[-30:], file["action"][:])
    assert (about.format, {*about.ignored}) == ("HDF5, a file for each demonstration", {"observations/images/top"})


@pytest.fixture
def folder(tmp_path):
    return samples.npz_folder(tmp_path)


def test_what_lies_beside_the_arrays_says_task_and_outcome(folder):
    recording = rpil.open(folder, outcome="success")
    assert recording.tasks == {"0": "lift", "1": "lift", "2": "lift"}
    assert recording.facts.outcomes[0].tolist() == [1.0, 1.0, 0.0]
    said = recording.description
    assert (said.observations, said.format) == (("state.0", "state.1"), "NPZ, a file for each demonstration")
    assert {*said.ignored} == {"obs_rgb", "success"}  # and not the seed beside them
    assert "The last value of obs_state, which comes after the last action, is left out." in said.notes


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"obs": np.ones((3, 2))}, "1/trajectory.npz: in a folder each file is one demonstration"),
        ({"actions": np.ones(3), "episode_ids": np.array([0, 0, 1])}, "names several; give the path"),
        ({"actions": np.ones((3, 2)), "obs_state": np.ones((5, 2))}, "'obs_state' has the shape"),
        ({"actions": np.array([{}], dtype=object)}, "'actions' has the shape|nested|type object"),
    ],
)
def test_files_that_are_no_demonstration_are_named(folder, arrays, message):
    np.savez(folder / "1" / "trajectory.npz", **arrays)
    with pytest.raises(DataError, match=message):
        rpil.read(folder, action="actions")


def test_two_files_in_one_folder_and_texts_that_are_no_json_are_refused(folder):
    lacks = "demonstration '2': it has no 'instruction', as others have"
    for text, said in (("{", "meta.json: no JSON"), ("[1]", lacks)):
        (folder / "2" / "meta.json").write_text(text)
        with pytest.raises(DataError, match=said):
            rpil.read(folder)
    assert rpil.open(folder, skip_bad=True).left_out == ("Skipped, because damaged: 2.",)
    (folder / "2" / "meta.json").write_text(json.dumps({"instruction": "put"}))
    shutil.copyfile(folder / "0" / "trajectory.npz", folder / "0" / "other.npz")
    with pytest.raises(DataError, match="another file here is of the same demonstration by its name; move one"):
        rpil.read(folder)


@pytest.mark.parametrize("kept", [[0], [2], [1, 2]])
def test_the_observation_after_the_last_action_is_kept_with_the_last_demonstration(tmp_path, kept):
    ids, seen = np.array([0, 0, 1, 1, 2]), np.arange(6.0)[:, None]
    np.savez(tmp_path / "a.npz", actions=np.ones((5, 1)), observations=seen, episode_ids=ids)
    rpil.open(tmp_path / "a.npz").keep(kept, tmp_path / "b.npz")
    with np.load(tmp_path / "b.npz") as found:
        np.testing.assert_array_equal(found["observations"], seen[np.isin([*ids, 2], kept)])
