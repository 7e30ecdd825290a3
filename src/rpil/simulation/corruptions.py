"""Seeded ways of spoiling a recorded episode, for benchmarks in which the bad demonstrations are known.

Every function takes the observations (n, D) and actions, (n,) or (n, A), that an expert recorded, what the environment
lets one do and a `numpy.random.Generator`, and returns new observations and actions; its input is never changed. A
uniform draw is from all K actions, so it can hit the expert's own, or from the whole box.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.data.spaces import Space

Rows = NDArray[Any]
Corruption = Callable[[Rows, Rows, Space, np.random.Generator], tuple[Rows, Rows]]


def corrupted(observations: Rows, actions: Rows, space: Space, rng: np.random.Generator) -> tuple[Rows, Rows]:
    """Replace every action by a uniform draw; the states stay those of the expert, who drove."""
    return observations.copy(), space.draw(len(actions), rng)


def flip(observations: Rows, actions: Rows, space: Space, rng: np.random.Generator) -> tuple[Rows, Rows]:
    """Swap the first and the last action, 0 and K-1; those between stay. In a box, mirror: low + high - action.

    For Mountain Car and Acrobot (K = 3) that is left and right, for Lunar Lander (K = 4) "nothing" and "right engine".
    """
    return observations.copy(), space.flip(actions)


def shift(observations: Rows, actions: Rows, space: Space, rng: np.random.Generator) -> tuple[Rows, Rows]:
    """Turn every action k into (k + 1) mod K. In a box, move every number on by half of its range, around."""
    return observations.copy(), space.shift(actions)


def noisy(observations: Rows, actions: Rows, space: Space, rng: np.random.Generator) -> tuple[Rows, Rows]:
    """Replace half of the actions (rounded up), at steps chosen at random, by uniform draws."""
    steps = rng.choice(len(actions), size=_half(len(actions)), replace=False)
    return observations.copy(), _redraw(actions, steps, space, rng)


def window(observations: Rows, actions: Rows, space: Space, rng: np.random.Generator) -> tuple[Rows, Rows]:
    """Replace the actions of one unbroken half of the steps (rounded up), at a random place, by uniform draws."""
    length = _half(len(actions))
    start = int(rng.integers(len(actions) - length + 1))
    return observations.copy(), _redraw(actions, slice(start, start + length), space, rng)


def sensor(observations: Rows, actions: Rows, space: Space, rng: np.random.Generator) -> tuple[Rows, Rows]:
    """Replace the observations by Gaussian noise with the mean and sd, per column, of this episode's; keep the actions.

    A column that never changes in the episode stays as it is.
    """
    # float64 for the moments: float32 sums drift over long episodes.
    exact = observations.astype(np.float64)
    noise = rng.normal(exact.mean(axis=0), exact.std(axis=0), size=observations.shape)
    kept = np.result_type(observations.dtype, np.float16)
    return noise.astype(kept), actions.copy()


CORRUPTIONS: dict[str, Corruption] = {
    "corrupted": corrupted,
    "flip": flip,
    "shift": shift,
    "noisy": noisy,
    "window": window,
    "sensor": sensor,
}

RANDOM = "random"
"""The kind that no function here can make: a uniform policy *drives* and is recorded, so the states change as well."""

KINDS: tuple[str, ...] = ("corrupted", RANDOM, *(name for name in CORRUPTIONS if name != "corrupted"))


def _half(n_steps: int) -> int:
    # Rounded up, so that even an episode of one step is touched.
    return (n_steps + 1) // 2


def _redraw(actions: Rows, steps: NDArray[np.int64] | slice, space: Space, rng: np.random.Generator) -> Rows:
    spoiled = actions.copy()
    spoiled[steps] = space.draw(len(spoiled[steps]), rng)
    return spoiled
