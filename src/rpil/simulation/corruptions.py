"""Corruptions of a recorded episode with a seed, for benchmarks in which bad demonstrations are labelled.

Every function takes the observations (n, D) and actions, (n,) or (n, A), of an expert, the space of the actions and a
`numpy.random.Generator`, and returns new observations and actions; its arguments are not changed. A uniform draw is
from all K actions, including the expert's, or from the whole box.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rpil.data.spaces import Space
from rpil.numerics.types import Array

Corruption = Callable[[Array, Array, Space, np.random.Generator], tuple[Array, Array]]


def corrupted(observations: Array, actions: Array, space: Space, rng: np.random.Generator) -> tuple[Array, Array]:
    """Replace every action by a uniform draw; the states stay those of the expert."""
    return observations.copy(), space.draw(len(actions), rng)


def flip(observations: Array, actions: Array, space: Space, rng: np.random.Generator) -> tuple[Array, Array]:
    """Swap the first and the last action, 0 and K-1; all others stay. In a box, mirror: low + high - action.

    For Mountain Car and Acrobot (K = 3) that is left and right, for Lunar Lander (K = 4) "nothing" and "right engine".
    """
    return observations.copy(), space.flip(actions)


def shift(observations: Array, actions: Array, space: Space, rng: np.random.Generator) -> tuple[Array, Array]:
    """Turn every action k into (k + 1) mod K. In a box, move every number on by half of its range, around."""
    return observations.copy(), space.shift(actions)


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


CORRUPTIONS: dict[str, Corruption] = {
    function.__name__: function for function in (corrupted, flip, shift, noisy, window, sensor)
}

RANDOM = "random"
"""The kind that no function here can make: a uniform policy *drives* and is recorded, so the states change as well."""

KINDS: tuple[str, ...] = ("corrupted", RANDOM, *(name for name in CORRUPTIONS if name != "corrupted"))


def _redraw(actions: Array, steps: NDArray[np.int64], space: Space, rng: np.random.Generator) -> Array:
    spoiled = actions.copy()
    spoiled[steps] = space.draw(len(steps), rng)
    return spoiled
