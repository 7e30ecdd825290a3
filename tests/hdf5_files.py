"""HDF5 files in the layouts of robomimic, robosuite, ALOHA and D4RL, small and of random numbers."""

import json

import numpy as np
import pytest

h5py = pytest.importorskip("h5py", reason="the extra hdf5 is not installed")

ENV = {"env_name": "Lift", "type": 1, "env_kwargs": {"control_freq": 20, "robots": ["Panda"]}}


def robomimic(path, names=("demo_0", "demo_2", "demo_10"), raw=False, parent="data", extra=0):
    """As robomimic, or with `raw` as robosuite; the number of steps is ten and the demonstration's place."""
    rng = np.random.default_rng(0)
    with h5py.File(path, "w") as file:
        data = file.require_group(parent)
        data.attrs["env_args"] = json.dumps(ENV)
        data.attrs["total"] = sum(10 + k for k in range(len(names)))
        for k, name in enumerate(names):
            n, demo = 10 + k, data.create_group(name)
            demo.attrs["num_samples"] = n
            demo.attrs["model_file"] = "<mujoco/>"
            demo["actions"] = rng.normal(size=(n, 7))
            demo["states"] = rng.normal(size=(n, 32))
            if not raw:
                demo["rewards"], demo["dones"] = np.zeros(n), np.zeros(n, int)
                demo["obs/robot/eef_pos"] = rng.normal(size=(n + extra, 3))
                demo["obs/gripper"] = rng.normal(size=(n + extra, 1))
                demo["obs/agentview_image"] = np.zeros((n + extra, 4, 4, 3), np.uint8)
                demo["next_obs/gripper"] = rng.normal(size=(n, 1))
                demo["initial_state/root_pose"] = rng.normal(size=(1, 7))
        if not raw and parent == "data":
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


def d4rl(path, lengths=(10, 12, 14), terminal=(0, 2), timeouts=True, following=False):
    """Demonstrations of these `lengths`; those numbered `terminal` end, and the others are cut short."""
    rng, n = np.random.default_rng(0), sum(lengths)
    ends = np.cumsum(lengths) - 1
    observations = rng.normal(size=(n, 4)).astype(np.float32)
    with h5py.File(path, "w") as file:
        file.create_dataset("observations", data=observations, compression="gzip")
        file["actions"] = rng.normal(size=(n, 2)).astype(np.float32)
        file["rewards"] = np.arange(n, dtype=float)
        file["terminals"] = np.isin(np.arange(n), ends[list(terminal)])
        file["infos/qpos"] = rng.normal(size=(n, 3))
        file["metadata/algorithm"] = "SAC"
        file["metadata/weights"] = np.ones((4, 4))
        if timeouts:
            file["timeouts"] = np.isin(np.arange(n), ends) & ~file["terminals"][:]
        if following:
            next_observations = np.roll(observations, -1, axis=0)
            next_observations[ends] += 1
            file["next_observations"] = next_observations
    return path
