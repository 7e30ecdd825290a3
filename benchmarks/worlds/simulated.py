"""Simulated demonstrations: experts of environments beside one kind of bad ones, and walks in which nobody is bad."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

import more_experts  # noqa: F401 (makes these known)
from rpil.data.demonstrations import Demonstrations
from rpil.simulation.simulate import BAD_KINDS, simulate
from worlds import World

ENVIRONMENTS = ("MountainCar-v0", "Acrobot-v1", "LunarLander-v3")
CONTINUOUS = ("Pendulum-v1", "MountainCarContinuous-v0", "LunarLanderContinuous-v3")
CONTINUOUS_KINDS = ("corrupted", "random", "noisy", "window", "sensor")
SHARES = (50, 75, 90)
"""Percent of the demonstrations that are bad."""
N_GOOD = 10
PAPER = tuple(product(("MountainCar-v0", "LunarLander-v3", "Acrobot-v1"), ("corrupted", "random")))
"""The cells of the paper."""


def of_paper(env: str, kind: str, seed: int) -> World:
    """Ten good and ten bad demonstrations."""
    made = simulate(env, kind, n_good=N_GOOD, n_bad=N_GOOD, seed=seed)
    return World.of(Demonstrations.from_episodes(made.episodes), made.is_good)


def grid() -> Iterator[tuple[str, str, int]]:
    """Every environment with every kind and share of bad demonstrations."""
    yield from product(ENVIRONMENTS, BAD_KINDS, SHARES)
    yield from product(CONTINUOUS, CONTINUOUS_KINDS, SHARES)


def of_grid(env: str, kind: str, share: int, seed: int = 1000) -> World:
    """Ten good demonstrations, and as many bad ones as make up `share` percent, in random order."""
    made = simulate(env, kind, n_good=N_GOOD, n_bad=round(N_GOOD * share / (100 - share)), seed=seed)
    order = np.argsort(-made.is_good, kind="stable")[np.random.default_rng(seed).permutation(len(made.episodes))]
    return World.of(Demonstrations.from_episodes([made.episodes[m] for m in order]), made.is_good[order])


def random_and_shifted(env: str, seed: int) -> World:
    """Ten good demonstrations, ten with random and ten with shifted actions."""
    random = simulate(env, "random", n_good=10, n_bad=10, seed=seed)
    shifted = simulate(env, "shift", n_good=0, n_bad=10, seed=seed)
    good = np.append(random.is_good, np.zeros(10, dtype=int)).astype(int)
    order = np.random.default_rng(seed).permutation(len(good))
    episodes = [*random.episodes, *shifted.episodes]
    return World.of(Demonstrations.from_episodes([episodes[m] for m in order]), good[order])


def walks(seed: int) -> World:
    """Random walks in a state space; all act by tanh(x W) with a noise of .1."""
    rng = np.random.default_rng([7, seed])
    size, weights = int(rng.integers(20, 51)), rng.normal(size=(6, 3))
    states = np.cumsum(0.2 * rng.normal(size=(size, 200, 6)), axis=1) + rng.normal(size=(size, 1, 6))
    actions = np.tanh(states @ weights) + 0.1 * rng.normal(size=(size, 200, 3))
    return World.of(Demonstrations.from_episodes(zip(states, actions, strict=True)), np.ones(size))
