"""Clean recordings that are not of robots, of kinds in which rules saw faults: each without any."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.formats.places import Times
from rpil.numerics.types import Array

Made = tuple[Demonstrations, Times]


def _followed(rng: np.random.Generator, steps: int, columns: int = 3, noise: float = 0.02) -> tuple[Array, Array]:
    """States (T, C) that follow smooth commands (T, C) two steps later."""
    time = np.arange(steps + 2)[:, None]
    path = np.sin(time / rng.uniform(6, 9, columns) + rng.uniform(0, 6, columns))
    path += np.cumsum(0.05 * rng.normal(size=path.shape), axis=0)
    return path[:-2] + noise * rng.normal(size=(steps, columns)), path[2:]


def whole_seconds(rng: np.random.Generator) -> Made:
    """Windows of a sensor at 50 Hz, whose clock counts whole seconds."""
    lengths, starts = rng.integers(120, 180, 154), rng.uniform(0, 1, 154)
    stamps = [np.floor(start + np.arange(n) / 50) for n, start in zip(lengths, starts, strict=True)]
    return Demonstrations.from_episodes([_followed(rng, n) for n in lengths]), Times(np.concatenate(stamps), 50.0)


def categories(rng: np.random.Generator) -> Made:
    """Trips whose first state is the number of a road section, one of 30, which say nothing of their order; a trip
    often passes sections in which others begin and end."""
    episodes, numbers = [], rng.permutation(30)
    for _ in range(150):
        n, first = int(rng.integers(80, 200)), int(rng.choice([0, 0, 0, 3, 7]))
        section = numbers[(first + np.arange(n) // int(rng.integers(12, 20))) % 12]
        states, actions = _followed(rng, n, 2)
        episodes.append((np.column_stack([section, states]), actions))
    return Demonstrations.from_episodes(episodes), Times()


def few_rows(rng: np.random.Generator) -> Made:
    """Demonstrations of 15 rows, in which a state follows the action with noise as large."""
    episodes = []
    for _ in range(164):
        actions = rng.normal(size=(16, 1))
        for t in range(1, 16):
            actions[t] += 0.5 * actions[t - 1]
        episodes.append((actions[:-1] + rng.normal(size=(15, 1)), actions[1:]))
    return Demonstrations.from_episodes(episodes), Times()


def rates(rng: np.random.Generator) -> Made:
    """The same motion at 100, 50 and 10 Hz."""
    episodes = []
    for m in range(90):
        states, actions = _followed(rng, int(rng.integers(280, 320)))
        every = (1, 2, 2, 2, 10)[m % 5]
        episodes.append((states[::every], actions[::every]))
    return Demonstrations.from_episodes(episodes), Times()


def repeated_rows(rng: np.random.Generator) -> Made:
    """An arm at 15 Hz whose recorder now and then writes a row a second time."""
    episodes = []
    for m in range(19):
        states, actions = _followed(rng, int(rng.integers(180, 320)), noise=0.0)
        for at in rng.integers(20, 160, int(m % 5 == 0) + int(m == 5)):
            states[at + 1] = states[at]
        episodes.append((states, actions))
    return Demonstrations.from_episodes(episodes), Times()


def reaches(rng: np.random.Generator) -> Made:
    """Reaches for one point, from anywhere; each holds it with a small tremor from the middle on."""
    episodes = []
    for _ in range(40):
        state, states, actions = 2 * rng.normal(size=2), [], []
        for _ in range(int(rng.integers(60, 140))):
            states.append(state)
            actions.append(-0.12 * state + 0.01 * rng.normal(size=2))
            state = state + actions[-1] + 0.002 * rng.normal(size=2)
        episodes.append((np.array(states), np.array(actions)))
    return Demonstrations.from_episodes(episodes), Times()


def amounts(rng: np.random.Generator) -> Made:
    """Amounts that do not go on from one step to the next, some of them far larger than most."""
    episodes = [(rng.standard_t(2, (n, 3)), rng.normal(size=(n, 2))) for n in rng.integers(20, 60, 100)]
    return Demonstrations.from_episodes(episodes), Times()


WORLDS: dict[str, Callable[[np.random.Generator], Made]] = {
    "a clock of whole seconds at 50 Hz": whole_seconds,
    "a state that is a category": categories,
    "demonstrations of 15 rows": few_rows,
    "three sampling rates": rates,
    "a row repeated now and then": repeated_rows,
    "reaches for one point": reaches,
    "amounts that do not go on": amounts,
}
"""What is recorded, and what makes it."""
