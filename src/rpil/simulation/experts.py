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
    """A deterministic controller for one environment."""

    predict: Callable[[NDArray[np.floating]], Array]
    """Maps observations (n, D), in the precision of the environment, to actions (n,) or (n, A), which are not clipped
    to its box."""


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
    turn, lift = _lander_errors(observations)
    lifting = (lift > np.abs(turn)) & (lift > 0.05)
    return np.select([lifting, turn < -0.05, turn > 0.05], [2, 3, 1], default=0)


def _lander_throttles(observations: NDArray[np.floating]) -> Array:
    """Steer as `_lunar_lander` does, with both engines at once, each in proportion to its error.

    Actions: throttle of the main engine, which is off below 0, and of the side engines, which are off within -0.5 ..
    0.5. Source: the same `heuristic` of Gymnasium; mean return 283 (sd 28) over 1,000 episodes, three of which crash.
    """
    turn, lift = _lander_errors(observations)
    return np.column_stack([lift * 20 - 1, -turn * 20])


def _lander_errors(observations: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """How far a lunar lander should turn and rise, (n,) each."""
    x, y, vx, vy, angle, spin, left_leg, right_leg = observations.T
    landed = (left_leg != 0) | (right_leg != 0)
    target_angle = np.clip(0.5 * x + vx, -0.4, 0.4)
    # Once a leg stands on the ground only the fall has to be slowed.
    turn = np.where(landed, 0, (target_angle - angle) * 0.5 - spin)
    lift = np.where(landed, -0.5 * vy, (0.55 * np.abs(x) - y) * 0.5 - 0.5 * vy)
    return turn, lift


def _cart_pole(observations: NDArray[np.floating]) -> NDArray[np.int64]:
    """Push towards the side the pole is falling to, leaning it back to the middle of the track.

    Observation: position x, velocity, pole angle (rad), angular velocity. Actions: 0 left, 1 right. Source: a linear
    feedback law with hand-set gains, our own; every one of 1,000 episodes reaches the limit of 500.
    """
    x, vx, angle, spin = observations.T
    return np.where(angle + 0.25 * spin + 0.05 * x + 0.1 * vx > 0, 1, 0)


def _pendulum_torque(observations: NDArray[np.floating]) -> Array:
    """Pump energy into the swing below, catch and hold the pendulum above, the two weighed by the height.

    Observation: cosine and sine of the angle (0 is up), angular velocity in rad/s. Action: a torque, -2 .. 2. Without a
    switch between the two the law is smooth but for the bounds. Source: our own, with gains chosen for the return and
    for being easy to clone; mean return -152 (sd 90) over 1,000 episodes, every one of which ends upright.
    """
    cosine, sine, speed = observations.T
    height = 0.5 + 0.5 * cosine
    pump, catch = 4.0 * sine + 2.0 * speed, -12.0 * sine - 3.0 * speed
    torque = (1.0 - height) * pump + height * catch
    return np.reshape(torque, (-1, 1))


def _mountain_car_force(observations: NDArray[np.floating]) -> Array:
    """Push along the motion, the harder the faster, which swings the car up ever higher.

    Observation: position, velocity v. Action: a force, -1 .. 1, whose square costs. Source: our own, a smooth
    saturation of the velocity; mean return 95.1 (sd 1.1) over 1,000 episodes, every one of which reaches the flag.
    """
    return np.asarray(np.tanh(30.0 * observations[:, 1:]))


EXPERTS: dict[str, Callable[[NDArray[np.floating]], Array]] = {
    "MountainCar-v0": _mountain_car,
    "Acrobot-v1": _acrobot,
    "LunarLander-v3": _lunar_lander,
    "CartPole-v1": _cart_pole,
    "Pendulum-v1": _pendulum_torque,
    "MountainCarContinuous-v0": _mountain_car_force,
    "LunarLanderContinuous-v3": _lander_throttles,
}
"""The rule of the expert of each environment."""
