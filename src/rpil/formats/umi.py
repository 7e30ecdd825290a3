"""Recordings of UMI's hand-held gripper, which have poses and no actions: an action is the move to the next pose."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from rpil.formats.step_arrays import StoredArray
from rpil.numerics.types import Array

NOTE = "There is no array action: an action is the move of pose and gripper to the next step, none at the last step."
WHOLE = re.compile(r"robot\d+_demo_(?:start|end)_pose")
"""Arrays that describe a demonstration as a whole."""

_POSE = re.compile(r"robot\d+_(?:eef_pos|eef_rot_axis_angle|gripper_width)")


def moves(arrays: Mapping[str, StoredArray], ends: Array) -> dict[str, Array]:
    """The action (N, K) by name, of each array (N, K) of poses; ``ends`` (M,) are where demonstrations end.

    A position and a width move by their difference, in the units of the file; an orientation, as a rotation vector, by
    the rotation from one to the next in radians, in the axes of the gripper. Where there are no poses there is nothing.
    """
    poses = {name: array for name, array in arrays.items() if _POSE.fullmatch(name) and len(array.shape) == 2}
    found = {}
    for name, array in poses.items():
        now = np.asarray(array[: int(ends[-1])])
        now = now if now.dtype.kind == "f" else now.astype(np.float64)  # differences of whole numbers may not be whole
        then = np.concatenate([now[1:], now[-1:]])
        then[ends[ends > 0] - 1] = now[ends[ends > 0] - 1]
        found[f"action.{name}"] = _turn(now, then) if name.endswith("axis_angle") else then - now
    return found


def _turn(now: Array, then: Array) -> Array:
    """The rotation from one orientation (N, 3) to another as a rotation vector."""
    from scipy.spatial.transform import Rotation

    turn: Array = (Rotation.from_rotvec(now).inv() * Rotation.from_rotvec(then)).as_rotvec()
    return turn.astype(now.dtype)
