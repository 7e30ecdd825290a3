"""Closed-form experts: controllers written as formulas, which give demonstrations of known quality.

They need no training and no files, so a benchmark that uses them is reproducible from its seed alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpil.data.errors import DataError
from rpil.numerics.types import Array


@dataclass(frozen=True)
class Expert:
    """A controller for one environment: a function from observations (n, D) to actions, (n,) or (n, A)."""

    predict: Callable[[NDArray[np.floating]], Array]


def expert(env_id: str) -> Expert:
    """The closed-form expert of an environment, whose id has a version, such as "MountainCar-v0".

    Raises
    ------
    DataError
        If there is no expert for this id.
    """
    if env_id not in EXPERTS:
        raise DataError(f"There is no closed-form expert for {env_id!r}: choose one of {', '.join(EXPERTS)}.")
    return Expert(EXPERTS[env_id])


def _mountain_car(observations: NDArray[np.floating]) -> NDArray[np.int64]:
    """Push along the direction of motion inside a band of velocities that depends on the position.

    Observation: position p, velocity v. Actions: 0 left, 1 nothing (never used), 2 right. Source: the controller by
    Zhiqing Xiao, published with Gym's leaderboard; mean return -102.7 (sd 13.7) over 1,000 episodes.
    """
    p, v = observations.T
    lower = np.minimum(-0.09 * np.square(p + 0.25) + 0.03, 0.3 * np.square(np.square(p + 0.9)) - 0.008)
    upper = -0.07 * np.square(p + 0.38) + 0.07
    at_rest_on_the_left = (p < -0.45) & (np.abs(v) < 0.001)
    inside_the_band = (lower < v) & (v < upper)
    climbing_to_the_flag = (p > 0.2) & (v > 0.02)
    right = at_rest_on_the_left | inside_the_band | climbing_to_the_flag | (p > 0.45)
    return np.where(right, 2, 0)


def _acrobot(observations: NDArray[np.floating]) -> NDArray[np.int64]:
    """Push the lower link along its rotation, or away from the side it hangs on when it hardly turns.

    Observation: cosine and sine of the first angle (x0, y0) and of the second (x1, y1), then their speeds (v0, v1) in
    rad/s. Actions: torque -1, 0 (never used), +1. Source: the controller by Zhiqing Xiao, published with Gym's
    leaderboard; mean return -90.4 (sd 42) over 1,000 episodes, one of which never swings up.
    """
    x0, y0, x1, y1, _, v1 = observations.T
    negative = np.where(np.abs(v1) > 0.3, v1 < 0, y1 + x0 * y1 + x1 * y0 > 0)
    return np.where(negative, 0, 2)


def _lunar_lander(observations: NDArray[np.floating]) -> NDArray[np.int64]:
    """Steer angle and height towards targets with a proportional-derivative law; the larger error takes the engine.

    Observation: position x, y, velocities, angle (rad), angular velocity, contact of either leg (0 or 1). Actions: 0
    nothing, 1 left engine, 2 main engine, 3 right engine. Source: the control law, with its gains, that Gymnasium ships
    as `heuristic` in `envs/box2d/lunar_lander.py`; mean return 235 (sd 113) over 1,000 episodes, 7 % of which crash.
    """
    x, y, vx, vy, angle, spin, left_leg, right_leg = observations.T
    landed = (left_leg != 0) | (right_leg != 0)
    target_angle = np.clip(0.5 * x + vx, -0.4, 0.4)
    # Once a leg stands on the ground only the fall has to be slowed.
    turn = np.where(landed, 0, (target_angle - angle) * 0.5 - spin)
    lift = np.where(landed, -0.5 * vy, (0.55 * np.abs(x) - y) * 0.5 - 0.5 * vy)
    lifting = (lift > np.abs(turn)) & (lift > 0.05)
    return np.select([lifting, turn < -0.05, turn > 0.05], [2, 3, 1], default=0)


EXPERTS: dict[str, Callable[[NDArray[np.floating]], Array]] = {
    "MountainCar-v0": _mountain_car,
    "Acrobot-v1": _acrobot,
    "LunarLander-v3": _lunar_lander,
}
"""The rule of the expert of each environment."""
