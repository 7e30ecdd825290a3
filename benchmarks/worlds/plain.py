"""Plain worlds in which one thing grows: demonstrations, steps, the share of bad ones, useless columns, classes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import numpy as np

from rpil.data.demonstrations import Demonstrations
from worlds import Array, World

Episode = tuple[Array, Array]
SHARES = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9)
SIZES = (50, 100, 200, 500, 1000)


def reach(rng: np.random.Generator, bad: bool, n_steps: int = 60) -> Episode:
    """Six joints go to one goal; bad ones jitter where they are."""
    goal, state = np.random.default_rng(0).normal(size=6), rng.normal(size=6)
    states, actions = [], []
    for _ in range(n_steps):
        action = state + (0.1 * rng.normal(size=6) if bad else 0.1 * (goal - state) + 0.02 * rng.normal(size=6))
        states.append(state)
        actions.append(action)
        state = 0.9 * action + 0.1 * state
    return np.array(states), np.array(actions)


def steer(rng: np.random.Generator, bad: bool, n_steps: int = 50) -> Episode:
    """A lane is kept; bad ones weave, each at its own frequency."""
    place, speed = rng.normal(size=2) * [1, 0.2]
    frequency, phase = rng.uniform(0.2, 0.5), rng.uniform(0, 6)
    states, actions = [], []
    for t in range(n_steps):
        bend = np.sin(t / 7)
        action = -0.5 * place - 0.8 * speed + 0.3 * bend + 0.05 * rng.normal()
        action += 0.6 * np.sin(frequency * t + phase) * bad
        states.append([place, speed, bend])
        actions.append([action])
        speed += 0.2 * action - 0.06 * bend
        place += 0.2 * speed
    return np.array(states), np.array(actions)


def choose(rng: np.random.Generator, bad: bool, n_steps: int = 30, n_classes: int = 4) -> Episode:
    """Classes by a linear rule; bad ones guess six times in ten."""
    rule, states = 1.5 * np.random.default_rng(7).normal(size=(5, n_classes)), rng.normal(size=(n_steps, 5))
    classes = (states @ rule + rng.gumbel(size=(n_steps, n_classes))).argmax(axis=1)
    guesses = rng.integers(0, n_classes, n_steps)
    return states, np.where(bad & (rng.random(n_steps) < 0.6), guesses, classes)


def late(rng: np.random.Generator, bad: bool, n_steps: int = 60) -> Episode:
    """A moving target is followed; bad ones act on where they were eight steps before."""
    state = rng.normal(size=3)
    seen, states, actions = [state] * 9, [], []
    for t in range(n_steps):
        seen.append(state)
        target = np.array([np.sin(t / 9), np.cos(t / 9), 0.5])
        action = 0.4 * (target - (seen[-9] if bad else state)) + 0.02 * rng.normal(size=3)
        states.append(np.concatenate([state, target]))
        actions.append(action)
        state = state + action
    return np.array(states), np.array(actions)


def made(drive: Callable[..., Episode], n: int, share: float, useless: int = 0, **more: int) -> World:
    """`n` demonstrations, each bad with the probability `share`, with so many `useless` columns."""
    good, episodes = np.empty(n, dtype=int), []
    for m in range(n):
        rng = np.random.default_rng([31, m])
        good[m] = rng.random() >= share
        states, actions = drive(rng, not good[m], **more)
        noise = np.random.default_rng([32, m]).normal(size=(len(states), useless))
        episodes.append((np.hstack([states, noise]), actions))
    return World.of(Demonstrations.from_episodes(episodes), good)


def cells() -> Iterator[tuple[str, Callable[[], World]]]:
    """The name of each cell, and what makes its world."""
    every = (reach, steer, choose, late)
    for drive, share, n in product(every, (0.2, 0.0), SIZES):
        yield f"size {n}, {drive.__name__}, {share:.0%} bad", partial(made, drive, n, share)
    for drive, share in product(every, SHARES):
        yield f"share {share}, {drive.__name__}", partial(made, drive, 100, share)
    for drive, n_steps in product(every[:3], (3, 5, 10, 20, 60, 200, 600)):
        yield f"steps {n_steps}, {drive.__name__}", partial(made, drive, 60, 0.2, n_steps=n_steps)
    for drive, useless in product(every[:3], (5, 20, 80, 300)):
        yield f"useless {useless}, {drive.__name__}", partial(made, drive, 60, 0.2, useless)
    for n_classes in (2, 3, 5, 10, 20, 50, 100):
        yield f"classes {n_classes}, choose", partial(made, choose, 80, 0.2, n_steps=40, n_classes=n_classes)
