"""The folder of the README: python tools/so100.py writes so100 into the current folder; it needs PyAV.

Fifty episodes of one arm with one camera, as docs/tutorials/make_episodes.py draws them, without the second arm and
with little idle time. In eight episodes the operator is distracted for two seconds. Four recordings are broken: in 12
the camera freezes, in 26 a joint, in 36 the gripper jumps, and in 41 half a second is missing.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import numpy as np

MAKER = Path(__file__).resolve().parents[1] / "docs" / "tutorials" / "make_episodes.py"
DISTRACTED, FROZEN_CAMERA, FROZEN_JOINT, JUMP, DROPPED = (3, 9, 15, 22, 30, 38, 44, 49), 12, 26, 36, 41
SHOWN = 5
"""Idle steps at each end."""

Rows = dict[str, np.ndarray]


def broken(m: int, rows: Rows) -> Rows:
    """The rows of an episode with little idle time, without the parked arm, and with what broke in it."""
    moving = np.flatnonzero((rows["action"] != rows["observation.state"]).any(axis=1))
    rows = {name: values[moving[0] - SHOWN : moving[-1] + SHOWN] for name, values in rows.items()}
    rows = {name: values if name == "observation.object" else values[:, :3] for name, values in rows.items()}
    if m == FROZEN_JOINT:
        rows["observation.state"][30:, 1] = rows["observation.state"][30, 1]
    if m == JUMP:
        rows["observation.state"][40:, 2] += 0.8
    if m == DROPPED:
        rows = {name: np.delete(values, slice(30, 40), axis=0) for name, values in rows.items()}
    return rows


def main() -> None:
    spec = importlib.util.spec_from_file_location("make_episodes", MAKER)
    assert spec is not None and spec.loader is not None  # noqa: PT018
    maker = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(maker)
    drawn: Callable[[int, int, float], Rows] = maker.episode
    write_video, lengths = maker.write_video, dict[int, int]()

    def episode(m: int, session: int, zero: float) -> Rows:
        rows = broken(m, drawn(m, session, zero))
        lengths[m] = len(rows["action"])
        return rows

    def write(path: Path, images: list[np.ndarray]) -> None:
        session = next(members for members in maker.SESSIONS.values() if max(members) == max(lengths))
        if FROZEN_CAMERA in session:
            start = sum(lengths[m] for m in session if m < FROZEN_CAMERA)
            images[start + 20 : start + lengths[FROZEN_CAMERA]] = [images[start + 20]] * (lengths[FROZEN_CAMERA] - 20)
        write_video(path, images)

    maker.ROOT, maker.BAD, maker.JOINTS = Path("so100"), DISTRACTED, ["shoulder_pan", "elbow", "gripper"]
    picture = maker.picture
    maker.picture = lambda state, target: picture(np.append(state, (0.3, 0.6)), target)  # the cup
    maker.episode, maker.write_video = episode, write
    maker.main()


if __name__ == "__main__":
    main()
