import json
import shutil

import numpy as np
import pytest

import rpil
import samples
from rpil.data.errors import DataError
from rpil.formats.registry import find


@pytest.fixture
def folder(tmp_path):
    return samples.npz_folder(tmp_path)


def test_what_lies_beside_the_arrays_says_task_and_outcome(folder):
    recording = rpil.open(folder, outcome="success")
    assert recording.tasks == {"0": "lift", "1": "lift", "2": "lift"}
    assert recording.facts.outcome.tolist() == [1.0, 1.0, 0.0]
    said = recording.describe()
    assert said.observations == ("state.0", "state.1")
    assert {"obs_rgb", "success"} <= {*said.ignored}
    assert "The last value of obs_state, which comes after the last action, is left out." in said.notes


def test_files_may_lie_in_the_folder_itself_in_the_order_of_their_numbers(tmp_path, folder):
    flat = tmp_path / "flat"
    flat.mkdir()
    for old, new in (("0", "run_2"), ("1", "run_10"), ("2", "run_1")):
        shutil.copyfile(folder / old / "trajectory.npz", flat / f"{new}.npz")
    assert rpil.read(flat).ids == ("run_1", "run_2", "run_10")
    find(flat).keep(tmp_path / "kept", ["run_10"])
    assert [file.name for file in (tmp_path / "kept").iterdir()] == ["run_10.npz"]
    assert (tmp_path / "kept" / "run_10.npz").read_bytes() == (flat / "run_10.npz").read_bytes()


def test_all_that_lies_beside_a_kept_file_is_kept(tmp_path, folder):
    (folder / "1" / "camera.mp4").write_bytes(b"video")
    find(folder).keep(tmp_path / "kept", ["1"])
    assert sorted(file.name for file in (tmp_path / "kept" / "1").iterdir()) == [
        "camera.mp4",
        "meta.json",
        "trajectory.npz",
    ]
    assert [file.name for file in (tmp_path / "kept").iterdir()] == ["1"]


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"obs": np.ones((3, 2))}, "1/trajectory.npz: no array holds the actions"),
        ({"actions": np.ones(3), "episode_ids": np.zeros(3, int)}, "holds several demonstrations"),
        ({"acts": np.ones(3), "indices": np.array([2]), "terminal": np.ones(2, bool)}, "holds several demonstrations"),
        ({"actions": np.ones((3, 2)), "obs_state": np.ones((5, 2))}, "'obs_state' has the shape"),
        ({"actions": np.array([{}], dtype=object)}, "'actions' has the shape|nested|type object"),
    ],
)
def test_files_that_are_no_demonstration_are_named(folder, arrays, message):
    np.savez(folder / "1" / "trajectory.npz", **arrays)
    with pytest.raises(DataError, match=message):
        rpil.read(folder, action="actions")


def test_two_files_in_one_folder_and_texts_that_are_no_json_are_refused(folder):
    (folder / "2" / "meta.json").write_text("{")
    with pytest.raises(DataError, match=r"meta.json: no JSON"):
        rpil.read(folder)
    (folder / "2" / "meta.json").write_text(json.dumps([1]))
    with pytest.raises(DataError, match="demonstration '2': it has no 'instruction', as others have"):
        rpil.read(folder)
    (folder / "2" / "meta.json").write_text(json.dumps({"instruction": "put"}))
    shutil.copyfile(folder / "0" / "trajectory.npz", folder / "0" / "other.npz")
    with pytest.raises(DataError, match="it holds 2 NPZ files"):
        rpil.read(folder)


def test_npz_files_beside_tables_are_not_read(tmp_path, folder):
    (folder / "notes.txt").write_text("recorded on Monday")
    assert len(rpil.read(folder)) == 3
    (folder / "data").mkdir()
    shutil.copyfile(samples.parquet_lists(tmp_path), folder / "data" / "lists.parquet")
    shutil.copyfile(folder / "0" / "trajectory.npz", folder / "0" / "other.npz")
    assert rpil.open(folder).describe().format == "Parquet"
