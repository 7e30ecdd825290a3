import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rpil import formats

zarr = pytest.importorskip("zarr", minversion="3", reason="needs the extra zarr")


def test_actions_of_umi_are_moves(tmp_path):
    rng, ends = np.random.default_rng(0), np.array([5, 5, 12])
    turns = Rotation.from_quat(rng.normal(size=(12, 4)))
    arrays = {
        "robot0_eef_pos": rng.normal(size=(12, 3)),
        "robot0_eef_rot_axis_angle": turns.as_rotvec(),
        "robot0_gripper_width": rng.uniform(size=(12, 1)),
        "robot0_demo_end_pose": rng.normal(size=(12, 6)),
    }
    root = zarr.create_group(tmp_path / "umi.zarr", zarr_format=2)
    for name, values in arrays.items():
        root.create_array(f"data/{name}", data=values)
    root.create_array("meta/episode_ends", data=ends)
    recording = formats.read_recording(tmp_path / "umi.zarr")
    d, about = recording.demonstrations, recording.description
    assert d.ids == (0, 2)
    assert any("Left out, because they have no steps: 1." in note for note in about.notes)
    assert any("move" in note for note in about.notes)
    assert about.ignored["robot0_demo_end_pose"] == "describes a demonstration as a whole"
    assert d.observations.shape == d.actions.shape == (12, 7)
    names = about.actions
    assert about.action_reason == f"{len(names)} numbers" == "7 numbers"
    for row in range(12):
        act = dict(zip(names, d.actions[row], strict=True))
        is_last = row in (4, 11)
        for k in range(3):
            moved = 0 if is_last else arrays["robot0_eef_pos"][row + 1, k] - arrays["robot0_eef_pos"][row, k]
            assert act[f"action.robot0_eef_pos.{k}"] == pytest.approx(moved, abs=1e-12)
        turn = [act[f"action.robot0_eef_rot_axis_angle.{k}"] for k in range(3)]
        after = turns[row] * Rotation.from_rotvec(turn)
        assert (after.inv() * turns[row if is_last else row + 1]).magnitude() == pytest.approx(0, abs=1e-7)
    asked = formats.read_recording(tmp_path / "umi.zarr", formats.ColumnOptions(action="robot0_eef_pos"))
    np.testing.assert_array_equal(asked.demonstrations.actions, arrays["robot0_eef_pos"])


def test_whole_numbers_may_fall(tmp_path):
    root = zarr.create_group(tmp_path / "umi.zarr", zarr_format=2)
    root.create_array("data/robot0_gripper_width", data=np.array([[3], [1], [4]], np.uint16))
    root.create_array("meta/episode_ends", data=np.array([3]))
    assert formats.read(tmp_path / "umi.zarr").actions.tolist() == [[-2], [3], [0]]
