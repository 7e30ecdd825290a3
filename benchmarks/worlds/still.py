"""Demonstrations that are bad because little is done in them: the arm held still, or its gripper left open, and a
pendulum with weak noisy torque."""

from __future__ import annotations

import zlib
from functools import partial
from typing import Any

import numpy as np

import value.worlds as arm
from rpil.data.demonstrations import Demonstrations
from value.operators import BAD, GOOD, Kind, Operator
from worlds import Array

STILL, OPEN = "gives up", "open gripper"
LIMIT = {STILL: 160, OPEN: 120}
"""Steps of those who never succeed."""
Set = tuple[Demonstrations, Array, tuple[str, ...]]
"""Demonstrations, which are good, and of which kind."""


class Stuck(Operator):
    """One who holds still from the middle on, or never closes the gripper, to the time limit; or any other kind."""

    def __init__(self, name: str, *others: Any, **named: Any) -> None:
        super().__init__((GOOD | BAD).get(name, Kind()), *others, **named)
        self.name = name

    def act(self, observation: Array, n: int) -> Array:
        action = super().act(observation, n)
        return np.array([0, 0, 0, action[3]]) if self.name == STILL and n >= self.middle else action

    def stops(self, n: int) -> bool:
        return n >= LIMIT[self.name] if self.name in LIMIT else super().stops(n)

    def _done(self, action: Array, n: int) -> Array:
        action = super()._done(action, n)
        self.first = float(action[3]) if n == 0 else self.first
        return np.append(action[:3], self.first) if self.name == OPEN else action


def on_the_arm(task: str, n_bad: int, kinds: tuple[str, ...], seed: int, n: int = 40) -> arm.World:
    rng = np.random.default_rng([77, seed, zlib.crc32(task.encode())])
    drawn = [str(kind) for kind in rng.permutation(kinds)]
    names = ["gentle" if gentle else "normal" for gentle in rng.random(n - n_bad) < arm.GENTLE]
    names += [drawn[m % len(drawn)] for m in range(n_bad)]
    episodes, success = [], []
    for m, name in enumerate(names):
        for _ in range(arm.TRIES if m < n - n_bad else 1):
            own, start = rng.spawn(1)[0], int(rng.integers(900_000))
            employed = partial(Stuck, name, side=np.array([1.0, 0, 0]), rng=own)
            episode, succeeded = arm.record_arm(task, employed, start)
            if succeeded:
                break
        episodes.append(episode)
        success.append(succeeded)
    order = rng.permutation(n)
    demonstrations = Demonstrations.from_episodes([episodes[m] for m in order])
    return arm.World(demonstrations, order < n - n_bad, np.array(success)[order], tuple(names[m] for m in order))


def pendulum(seed: int) -> Set:
    """Swings at full torque, and one in five weak, noisy and in the wrong direction."""
    rng, is_good = np.random.default_rng(seed), np.arange(30) % 5 != 4
    episodes = []
    for good in is_good:
        angle, speed = rng.uniform(-np.pi, np.pi), rng.uniform(-1, 1)
        states, torques = [], []
        for _ in range(100):
            x = (angle + np.pi) % (2 * np.pi) - np.pi
            u = -10 * x - 2.5 * speed if abs(x) < 0.8 else 2 * np.sign(speed if abs(speed) > 0.1 else 1)
            u = np.clip(u * (1 if good else -0.3) + (0.05 if good else 1.0) * rng.normal(), -2, 2)
            states.append((np.cos(angle), np.sin(angle), speed))
            torques.append([u])
            speed = np.clip(speed + (15 * np.sin(angle) + 3 * u) * 0.05, -8, 8)
            angle += speed * 0.05
        episodes.append((np.array(states), np.array(torques)))
    return Demonstrations.from_episodes(episodes), is_good, tuple("good" if good else "feeble" for good in is_good)
