import numpy as np
import pytest

from hdf5_files import d4rl, h5py
from rpil import formats
from rpil.data.errors import DataError


def change(path, **arrays):
    """Replace arrays of a file, or add or remove (None) some."""
    with h5py.File(path, "r+") as file:
        for name, array in arrays.items():
            if name in file:
                del file[name]
            if array is not None:
                file[name] = array
    return path


def test_demonstrations_end_at_terminals_and_timeouts(tmp_path):
    path = d4rl(tmp_path / "hopper.hdf5")
    recording = formats.read_recording(path)
    demonstrations = recording.demonstrations
    assert demonstrations.ids == (0, 1, 2)
    assert demonstrations.lengths.tolist() == [10, 12, 14]
    with h5py.File(path) as file:
        np.testing.assert_array_equal(demonstrations.observations, file["observations"][:])
        np.testing.assert_array_equal(demonstrations.actions, file["actions"][:])
    ignored = recording.description.ignored
    assert {"terminals", "timeouts", "rewards", "infos/qpos", "metadata/weights"} == set(ignored) - {
        "metadata/algorithm"
    }


@pytest.mark.parametrize(
    ("following", "lengths", "note"),
    [(True, [10, 12, 14], "next_observations"), (False, [10, 26], "terminals alone")],
)
def test_without_timeouts_they_end_where_observations_jump_or_else_at_terminals(tmp_path, following, lengths, note):
    recording = formats.read_recording(d4rl(tmp_path / "maze.hdf5", timeouts=False, following=following))
    assert recording.demonstrations.lengths.tolist() == lengths
    assert note in recording.description.notes[0]
    assert ("next_observations" in recording.description.ignored) == following


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"next_observations": np.ones((36, 4))}, "the order of the steps was lost"),
        ({"next_observations": np.ones((35, 4))}, r"next_observations has the shape \(35, 4\)"),
    ],
)
def test_files_that_do_not_say_where_demonstrations_begin(tmp_path, arrays, message):
    path = change(d4rl(tmp_path / "maze.hdf5", timeouts=False), **arrays)
    with pytest.raises(DataError, match=rf"^maze.hdf5: .*{message}"):
        formats.read(path)


@pytest.mark.parametrize("ids", [np.array(["a", "b"], object), np.array([3.0, 4.0])])
def test_ids_are_texts_of_any_length_or_whole_numbers(tmp_path, ids):
    with h5py.File(tmp_path / "two.hdf5", "w") as file:
        file["observations"], file["actions"], file["episode_id"] = np.ones((5, 2)), np.eye(5), np.repeat(ids, [2, 3])
    assert formats.read(tmp_path / "two.hdf5").ids == tuple(ids.tolist())


def test_one_step_and_the_next_observation_are_a_demonstration(tmp_path):
    with h5py.File(tmp_path / "one.hdf5", "w") as file:
        for name in ("observations", "actions", "next_observations"):
            file[name] = np.ones((1, 2))
    assert formats.read(tmp_path / "one.hdf5").lengths.tolist() == [1]
