"""Experts that are formulas, and good and bad demonstrations of an environment, made from one seed.

A corruption takes the observations (n, D) and actions, (n,) or (n, A), of an expert, the space of the actions and a
`numpy.random.Generator`, and returns new observations and actions; its arguments are not changed.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpil.data.errors import DataError
from rpil.data.spaces import Discrete, Space
from rpil.numerics.types import Array
from rpil.simulation.rollouts import actions_of, make, record


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


def draw(space: Space, n_steps: int, rng: np.random.Generator) -> Array:
    """Uniform draws from all K actions, including the expert's, or from the whole box."""
    if isinstance(space, Discrete):
        return rng.integers(space.n, size=n_steps)
    return rng.uniform(space.low, space.high, size=(n_steps, space.n_parts)).astype(space.low.dtype)


def corrupted(observations: Array, actions: Array, space: Space, rng: np.random.Generator) -> tuple[Array, Array]:
    """Replace every action by a uniform draw; the states stay those of the expert."""
    return observations.copy(), draw(space, len(actions), rng)


def flip(observations: Array, actions: Array, space: Space, rng: np.random.Generator) -> tuple[Array, Array]:
    """Swap the first and the last action, 0 and K-1; all others stay. In a box, mirror: low + high - action."""
    if isinstance(space, Discrete):
        swapped = np.arange(space.n)
        swapped[[0, -1]] = swapped[[-1, 0]]
        return observations.copy(), swapped[actions]
    return observations.copy(), space.bounded(space.low + space.high - actions)


def shift(observations: Array, actions: Array, space: Space, rng: np.random.Generator) -> tuple[Array, Array]:
    """Turn every action k into (k + 1) mod K. In a box, move every number on by half of its range, around."""
    if isinstance(space, Discrete):
        return observations.copy(), (actions + 1) % space.n
    span = space.high - space.low
    return observations.copy(), space.bounded(space.low + (actions - space.low + span / 2) % span)


def noisy(observations: Array, actions: Array, space: Space, rng: np.random.Generator) -> tuple[Array, Array]:
    """Replace half of the actions (rounded up), at steps chosen at random, by uniform draws."""
    steps = rng.choice(len(actions), size=(len(actions) + 1) // 2, replace=False)
    return observations.copy(), _redraw(actions, steps, space, rng)


def window(observations: Array, actions: Array, space: Space, rng: np.random.Generator) -> tuple[Array, Array]:
    """Replace the actions of one unbroken half of the steps (rounded up), at a random place, by uniform draws."""
    steps = np.arange((len(actions) + 1) // 2)
    steps += rng.integers(len(actions) - len(steps) + 1)
    return observations.copy(), _redraw(actions, steps, space, rng)


def sensor(observations: Array, actions: Array, space: Space, rng: np.random.Generator) -> tuple[Array, Array]:
    """Replace the observations by Gaussian noise with the mean and sd, per column, of this episode's; keep the actions.

    A column that never changes in the episode stays as it is.
    """
    # float64 for the moments: float32 sums drift over long episodes.
    exact = observations.astype(np.float64)
    noise = rng.normal(exact.mean(axis=0), exact.std(axis=0), size=observations.shape)
    kept = np.result_type(observations.dtype, np.float16)
    return noise.astype(kept), actions.copy()


CORRUPTIONS: dict[str, Callable[[Array, Array, Space, np.random.Generator], tuple[Array, Array]]] = {
    function.__name__: function for function in (corrupted, flip, shift, noisy, window, sensor)
}

RANDOM = "random"  # which no function here can make: a uniform policy drives, so the states change as well

BAD_KINDS: tuple[str, ...] = ("corrupted", RANDOM, *(name for name in CORRUPTIONS if name != "corrupted"))


def _redraw(actions: Array, steps: NDArray[np.int64], space: Space, rng: np.random.Generator) -> Array:
    spoiled = actions.copy()
    spoiled[steps] = draw(space, len(steps), rng)
    return spoiled


@dataclass(frozen=True, eq=False)
class Simulation:
    """M simulated demonstrations, good and bad in random order."""

    episodes: list[tuple[Array, Array]]
    """Observations (n, D) and actions, (n,) or (n, A), of each."""
    is_good: NDArray[np.int64]
    """1 for the expert's own demonstrations, 0 for the bad ones, (M,)."""
    returns: NDArray[np.float64]
    """Undiscounted return of the episode as it was played, (M,): of the expert for all kinds but "random"."""


def simulate(env_id: str, kind: str, *, n_good: int, n_bad: int, seed: int) -> Simulation:
    """Record the closed-form expert of an environment, and corrupt some of the demonstrations.

    The good episodes depend on neither `kind` nor `n_bad`, and for every kind but "random" the same episodes are
    corrupted: results for two kinds with one seed differ by the kind alone. Good and bad are in random order, because
    data sorted by quality would give the answer away; the good ones keep their own order.

    Parameters
    ----------
    env_id : str
        An environment with an expert in `rpil.simulation.simulate`.
    kind : str
        One of `rpil.simulation.simulate.BAD_KINDS`.
    n_good, n_bad : int
        Numbers of good and of bad demonstrations, 0 or more.
    seed : int
        Determines all demonstrations.

    Returns
    -------
    Simulation

    Raises
    ------
    DataError
        If the environment has no expert, the kind is unknown or there is nothing to simulate.
    """
    if kind not in BAD_KINDS:
        raise DataError(f"There is no kind of bad demonstration {kind!r}: choose one of {', '.join(BAD_KINDS)}.")
    if n_good < 0 or n_bad < 0 or n_good + n_bad == 0:
        raise DataError(f"n_good = {n_good} and n_bad = {n_bad} make no demonstrations: ask for at least one in all.")
    driver = expert(env_id)
    with closing(make(env_id)) as env:
        space = actions_of(env)
    seeds = np.random.SeedSequence(seed).generate_state(5).tolist()
    good_seed, bad_seed, policy_seed, corruption_seed, order_seed = seeds

    good = record(driver, env_id, n_episodes=n_good, seed=good_seed)
    rng = np.random.default_rng(policy_seed)
    at_random = Expert(lambda observations: draw(space, len(observations), rng))
    bad = record(at_random if kind == RANDOM else driver, env_id, n_episodes=n_bad, seed=bad_seed)
    episodes = [(episode.observations, episode.actions) for episode in [*good, *bad]]
    if kind != RANDOM:
        # One generator per episode: the first bad demonstrations do not depend on `n_bad`.
        streams = np.random.default_rng(corruption_seed).spawn(n_bad)
        episodes[n_good:] = [
            CORRUPTIONS[kind](*episode, space, own) for episode, own in zip(episodes[n_good:], streams, strict=True)
        ]
    is_good = np.random.default_rng(order_seed).permutation(np.repeat([1, 0], [n_good, n_bad]))
    order = np.argsort(np.argsort(-is_good, kind="stable"))  # the good, and the bad, among themselves as recorded
    return Simulation(
        episodes=[episodes[m] for m in order.tolist()],
        is_good=is_good,
        returns=np.array([episode.rewards.sum() for episode in [*good, *bad]])[order],
    )
