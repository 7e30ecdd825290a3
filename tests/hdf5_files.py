"""HDF5 files in the layouts of robomimic, robosuite, ALOHA and D4RL, small and of random numbers."""

import json

import numpy as np
import pytest

h5py = pytest.importorskip("h5py", reason="the extra hdf5 is not installed")

ENV = {"env_name": "Lift", "type": 1, "env_kwargs": {"control_freq": 20, "robots": ["Panda"]}}


def robomimic(path, raw=False, parent="data"):
    """As robomimic and Isaac Lab, or with `raw` as robosuite, of 10, 11 and 12 steps; the second one failed."""
    rng, names = np.random.default_rng(0), ("demo_0", "demo_2", "demo_10")
    with h5py.File(path, "w") as file:
        data = file.require_group(parent)
        data.attrs.update(env_args=json.dumps(ENV), total=33)
        for k, name in enumerate(names):
            n, demo = 10 + k, data.create_group(name)
            demo.attrs.update(num_samples=n, model_file="<mujoco/>", seed=42 + k, success=k != 1, operator="ab"[k % 2])
            demo["actions"] = rng.normal(size=(n, 7))
            demo["states"] = rng.normal(size=(n, 32))
            if not raw:
                demo["rewards"], demo["dones"] = np.zeros(n), np.zeros(n, int)
                demo["obs/robot/eef_pos"] = rng.normal(size=(n, 3))
                demo["obs/gripper"] = rng.normal(size=(n, 1))
                demo["obs/agentview_image"] = np.zeros((n, 4, 4, 3), np.uint8)
                demo["next_obs/gripper"] = rng.normal(size=(n, 1))
                demo["initial_state/root_pose"] = rng.normal(size=(1, 7))
        if not raw and parent != "/":
            file["mask/train"] = np.array(names[:2], dtype="S")
            file["mask/valid"] = np.array(names[2:], dtype="S")
    return path


def aloha(folder, n_files=3):
    """A folder of `n_files` episodes, written from the last to the first."""
    rng = np.random.default_rng(0)
    folder.mkdir()
    for k in reversed(range(n_files)):
        with h5py.File(folder / f"episode_{k}.hdf5", "w") as file:
            file.attrs["sim"] = True
            for name in ("qpos", "qvel"):
                file[f"observations/{name}"] = rng.normal(size=(20 + k, 14)) + k
            file["observations/images/top"] = np.zeros((20 + k, 4, 4, 3), np.uint8)
            file["action"] = rng.normal(size=(20 + k, 14)).astype(np.float32)
    return folder


def d4rl(path):
    """Demonstrations of 10, 12 and 14 steps, of which the second one is cut short."""
    rng, n, ends = np.random.default_rng(0), 36, [9, 21, 35]
    with h5py.File(path, "w") as file:
        file.create_dataset("observations", data=rng.normal(size=(n, 4)).astype(np.float32), compression="gzip")
        file["actions"] = rng.normal(size=(n, 2)).astype(np.float32)
        file["rewards"] = np.arange(n, dtype=float)
        file["terminals"] = np.isin(np.arange(n), ends[::2])
        file["timeouts"] = np.arange(n) == ends[1]
        file["infos/qpos"] = rng.normal(size=(n, 3))
        file["metadata/algorithm"] = "SAC"
        file["metadata/weights"] = np.ones((4, 4))
    return path
