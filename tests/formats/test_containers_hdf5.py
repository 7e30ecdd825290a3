from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

import rpil
from hdf5_files import h5py, robomimic
from hostile import full_disk
from problems import refused
from rpil import formats
from rpil.data.arrays import LONGEST_TEXT
from rpil.data.errors import DataError
from rpil.formats.columns import ColumnOptions
from rpil.formats.registry import find
from rpil.formats.step_arrays import NO_STEPS, NOT_IN_ALL, OF_WHOLE


def contents(path):
    """All arrays by path, and all attributes."""
    with h5py.File(path) as file:
        found = {("/", key): value for key, value in file.attrs.items()}

        def visit(name, member):
            found.update({(name, key): value for key, value in member.attrs.items()})
            if isinstance(member, h5py.Dataset):
                found[name] = member[()].tolist()

        file.visititems(visit)
    return found


def test_low_dimensional_observations_are_read_in_the_order_of_numbers(tmp_path):
    path = robomimic(tmp_path / "lift.hdf5")
    recording = formats.read_recording(path)
    demonstrations, about = recording.demonstrations, recording.description
    assert (demonstrations.ids, [*demonstrations.lengths]) == (("demo_0", "demo_2", "demo_10"), [10, 11, 12])
    assert set(demonstrations.observation_names) == {"gripper", *(f"robot/eef_pos.{k}" for k in range(3))}
    with h5py.File(path) as file:
        last = file["data/demo_10"]
        names = [name if name != "gripper" else "gripper.0" for name in demonstrations.observation_names]
        expected = [last[f"obs/{name.rpartition('.')[0]}"][:, int(name[-1])] for name in names]
        np.testing.assert_array_equal(demonstrations.observations[-12:], np.column_stack(expected))
        np.testing.assert_array_equal(demonstrations.actions[-12:], last["actions"][:])
    assert (about.tasks, about.fps, about.notes) == (("Lift",), 20, ())
    reasons = {"obs/agentview_image": "images or nested values", "initial_state/root_pose": NO_STEPS}
    assert reasons.items() <= about.ignored.items()
    assert {"states", "next_obs/gripper", "rewards", "dones"} < set(about.ignored)


@pytest.mark.parametrize(("parent", "action"), [("data", ()), ("episodes", ()), ("/", "leader/*")])
def test_kept_demonstrations_are_as_they_were_with_all_else_of_the_file(tmp_path, parent, action):
    path = robomimic(tmp_path / "all.hdf5", parent=parent)
    with h5py.File(path, "r+") as file:
        file.attrs["made by"] = "us"
        file["other/array"] = np.arange(3)
        if parent == "/":
            file["data/index"] = file["episodes/index"] = np.arange(3)  # where no group holds actions
            file["mask/train"], file["mask/valid"] = np.array([b"demo_0", b"demo_2"]), np.array([b"demo_10"])
            for name in ("demo_0", "demo_2", "demo_10"):
                file.move(f"{name}/actions", f"{name}/leader/cmd")
    find(path).keep(tmp_path / "kept.hdf5", ["demo_10", "demo_0"], ColumnOptions(action=action))
    before, after, total = contents(path), contents(tmp_path / "kept.hdf5"), (parent, "total")
    assert after.pop(total) == 10 + 12
    masks = {"mask/train": [b"demo_0"], "mask/valid": [b"demo_10"]}
    assert {name: after.pop(name) for name in masks} == masks
    assert after == {k: v for k, v in before.items() if "demo_2" not in str(k) and k not in {total, *masks}}


def test_a_file_as_robosuite_wrote_it():
    recording = formats.read_recording(Path(__file__).parent / "files" / "robosuite_stack.hdf5")
    about, demonstrations = recording.description, recording.demonstrations
    assert (about.tasks, demonstrations.ids, demonstrations.actions.shape) == (("Stack",), ("demo_1",), (50, 7))
    assert demonstrations.observations.shape == (50, 44)  # without the time of the simulator
    assert "joint_torques" in about.ignored


def test_attributes_of_groups_are_facts_where_they_are_named(tmp_path):
    path = robomimic(tmp_path / "isaac.hdf5")
    recording = rpil.open(path)
    assert {recording.description.ignored[name] for name in ("success", "operator", "seed")} == {OF_WHOLE}
    assert (recording.operators, {*recording.tasks.values()}) == ([], {"Lift"})
    assert recording.times().frames == {"demo_0": 10, "demo_2": 11, "demo_10": 12}
    recording = rpil.open(path, outcome=["succ*", "-seed"], session="Seed", task="operator", operator="operator")
    assert [one.tolist() for one in recording.facts.outcomes] == [[1, 0, 1], [-42, -43, -44]]
    assert recording.facts.sessions == ("42", "43", "44")
    assert recording.operators == [*recording.tasks.items()] == [("demo_0", "a"), ("demo_2", "b"), ("demo_10", "a")]
    with h5py.File(path, "r+") as file:  # an array counts before an attribute of its name
        for name, demo in file["data"].items():
            demo["success"], demo["seed"] = np.full(len(demo["actions"]), name != "demo_0"), name == "demo_2"
            demo.attrs["task"] = f"lift {name}"  # which counts before what is said of all
            h5py.h5a.create(demo.id, b"\xff", h5py.h5t.NATIVE_INT8, h5py.h5s.create(h5py.h5s.SCALAR))  # is not named
            demo.attrs["num_samples"] = {"demo_0": True, "demo_2": np.bytes_(b"\xff")}.get(name, 12)
    recording = rpil.open(path, outcome=["success", "seed"])
    assert [one.tolist() for one in recording.facts.outcomes] == [[0, 1, 1], [0, 1, 0]]
    assert (recording.tasks, recording.times().frames) == ({m: f"lift {m}" for m in recording.ids}, {"demo_10": 12})
    broken = "Not read, because they hold no JSON: ep_meta of demo_2; write them again."
    # A task counts neither before its own, nor in some alone.
    for lang, task, found in (("pick", "x", "pick"), *((lang, [1, 2], "Lift") for lang in ("", '"'))):
        with h5py.File(path, "r+") as file:
            file["data/demo_2"].attrs.update(ep_meta=f'{{"lang": "{lang}"}}', task=task)
        assert [*rpil.open(path).tasks.values()] == ["Lift", found, "Lift"]
        assert (broken in rpil.open(path).description.notes) == (lang == '"')


NO_FACTS = [[1, 2], h5py.Empty("f"), np.array((1, 2.0), "i4,f8"), "b" * (LONGEST_TEXT + 1), np.bytes_(60_000 * b"b")]
NO_FACTS += [np.uint64(2**64 - 1), np.longdouble(1), np.bytes_(b"\xff")]


@pytest.mark.parametrize(
    ("first", "other", "found"),
    [
        (True, 2.5, [1, 2.5]), ([3], 4, [3, 4]), (7, "yes", ["7", "yes"]),
        (np.bytes_(b"a"), "b" * LONGEST_TEXT, ["a", "b" * LONGEST_TEXT]),
        (1, None, "'demo_2': it has no 'fact', as others have"),
        *((value, 1, "'demo_0': 'fact' has the shape") for value in NO_FACTS),
    ],
)  # fmt: skip
def test_facts_are_numbers_or_short_texts(tmp_path, first, other, found):
    path = robomimic(tmp_path / "lift.hdf5")
    with h5py.File(path, "r+") as file:
        for name, demo in file["data"].items():
            demo.attrs.update({} if (value := first if name == "demo_0" else other) is None else {"fact": value})
    assert rpil.open(path).description.ignored["fact"] == (NO_STEPS if "shape" in found else OF_WHOLE)
    with refused(found) if isinstance(found, str) else nullcontext():
        assert [value for _, value in rpil.open(path, operator="fact").operators] == [*found, found[1]]


@pytest.mark.parametrize("odd", ["demo_0", "demo_2"])
def test_a_demonstration_that_differs_from_most_is_skipped_if_asked(tmp_path, odd):
    path = robomimic(tmp_path / "lift.hdf5")
    with h5py.File(path, "r+") as file:
        del file[f"data/{odd}/obs/gripper"]
        file[f"data/{odd}/obs/gripper"] = np.ones((3, 2))
    with refused(rf"'{odd}': 'obs/gripper' has the shape \(3, 2\) .*; read with skip_bad=True, or leave"):
        rpil.read(path)
    recording = rpil.open(path, skip_bad=True)
    assert recording.left_out == (f"Skipped, because damaged: {odd}.",)
    assert {*recording.ids} == {"demo_0", "demo_2", "demo_10"} - {odd}
    assert "not in the data" not in str(rpil.check(recording))


def test_a_demonstration_is_as_long_as_the_longest_actions_that_are_named(tmp_path):
    path = robomimic(tmp_path / "lift.hdf5")
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            demo["action bias"], demo["actions next"] = [1.0], np.ones((len(demo["actions"]) + 1, 2))
    assert rpil.read(path, action=["actions next", "actions"]).lengths.tolist() == [10, 11, 12]
    with refused("'demo_0': 'action bias' has the shape"):
        rpil.read(path, action="action*")


def test_filter_keys_in_other_files_are_not_read(tmp_path):
    path, output = robomimic(tmp_path / "lift.hdf5"), tmp_path / "kept.hdf5"
    with h5py.File(tmp_path / "other.hdf5", "w") as other:
        other["names"] = np.array(["demo_0", "demo_2"], dtype="S")
    layout = h5py.VirtualLayout((2,), "S6")
    layout[:] = h5py.VirtualSource(tmp_path / "other.hdf5", "names", (2,), "S6")
    with h5py.File(path, "a") as file:
        file.create_virtual_dataset("mask/elsewhere", layout)
        file["mask/link"] = h5py.ExternalLink(tmp_path / "other.hdf5", "names")
        file.create_group("mask/group")
    find(path).keep(output, ["demo_0", "demo_10"])
    with h5py.File(output) as file:
        assert {m: one[()].tolist() for m, one in file["mask"].items()} == {"train": [b"demo_0"], "valid": [b"demo_10"]}


@pytest.mark.parametrize("room", [3_000, 20_000])
def test_a_full_disk_is_not_blamed_on_the_data(tmp_path, room):
    path, output = robomimic(tmp_path / "lift.hdf5"), tmp_path / "kept.hdf5"
    with full_disk(room), pytest.raises(DataError, match=r"kept\.hdf5: it cannot be written") as caught:
        find(path).keep(output, ["demo_0", "demo_10"])
    assert len(str(caught.value)) < len(str(output)) + 100  # and no text of the library
    assert [file.name for file in tmp_path.iterdir()] == ["lift.hdf5"]


def test_what_nobody_saw_is_no_observation(tmp_path):
    """As Isaac Lab Mimic writes it: last actions, what made the data, and labels stand among the observations."""
    path = robomimic(tmp_path / "isaac.hdf5")
    unseen = ("actions", "datagen_info/target_eef_pose/franka", "datagen_info/subtask_term_signals/grasp")
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            for name in unseen:
                demo[f"obs/{name}"] = np.random.default_rng(1).normal(size=(len(demo["actions"]), 4))
            demo["goal/x"] = demo["actions"][:]
            demo["goal_reached"] = np.zeros(len(demo["actions"]))
    said = formats.read_recording(path).description
    assert said.observations == ("gripper", "robot/eef_pos.0", "robot/eef_pos.1", "robot/eef_pos.2")
    reasons = ("the last action", "commands and labels of the program that made the data", "labels of subtasks")
    assert tuple(said.ignored[f"obs/{name}"] for name in unseen) == reasons
    goal = "No goal is read: --observations takes goal/x, with the names of all others."
    for given, n in ((None, 4), ("obs/actions, obs/datagen_info/*", 12), ("gripper,goal/*", 8)):
        said = rpil.open(path, **({"observations": given} if given else {})).description
        assert (len(said.observations), goal in said.notes) == (n, given is None)


def test_the_time_of_the_simulator_is_no_observation(tmp_path):
    path = robomimic(tmp_path / "raw.hdf5", raw=True)
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            demo["states"][:, 0] = 0.3 + 0.05 * np.arange(len(demo["actions"]))
    recording = formats.read_recording(path)
    assert recording.description.observations == tuple(f"states.{k}" for k in range(1, 32))
    assert recording.description.ignored["states.0"] == "time or number of the step"
    with h5py.File(path) as file:
        found = recording.demonstrations.select(slice(0, 1)).observations
        np.testing.assert_array_equal(found, file["data/demo_0/states"][:, 1:])
    assert formats.read_recording(path, ColumnOptions(observations="states")).demonstrations.n_observations == 32


def test_groups_are_kept_by_their_names_alone(tmp_path):
    path = robomimic(tmp_path / "lift.hdf5")
    with pytest.raises(DataError, match="keep writes no groups by other ids than their names; write the list with"):
        find(path).keep(tmp_path / "kept.hdf5", ["demo_0"], ColumnOptions(id="operator"))


def test_what_is_not_read_is_named(tmp_path):
    path = robomimic(tmp_path / "lift.hdf5")
    with h5py.File(path, "r+") as file:
        file["data/demo_2/obs/force"] = np.ones((11, 3))
        file["data/demo_0/about"] = h5py.Empty("f")
        file["data/version"] = 3
        file["data/demo_4"] = h5py.SoftLink("/data/demo_0")
        for k, demo in enumerate(("demo_0", "demo_2", "demo_10")):
            file[f"data/{demo}/operator"] = np.array(["Ann" if k else "Bo"] * (10 + k), object)
    recording = formats.read_recording(path)
    about = recording.description
    assert (about.ignored["obs/force"], about.ignored["about"]) == (NOT_IN_ALL, NO_STEPS)
    links = "Not read, because they are links: data/demo_4."
    assert {links, "Left out, because they are links, or hold no actions: version."} <= {*about.notes}
    # Texts of any length, as h5py writes them.
    assert recording.operators == [("demo_0", "Bo"), ("demo_2", "Ann"), ("demo_10", "Ann")]
