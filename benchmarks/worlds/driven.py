"""Worlds of a point that is steered to a goal, in which policies are driven: six kinds of bad demonstrations.

All good demonstrations are by one rule, a spring to the goal and a damper. Bad ones see late (latency), do not see
where the goal is (hidden goal), skip the first of two goals (two stages), brake too little (overshoot), each follow a
rule of their own (diverse), or are recorded by a sensor that is off (sensor shifted). Actions are forces, or one of
five directions. Nothing in the library was chosen on these.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rpil.data.demonstrations import Demonstrations
from worlds import Array, World
from worlds.point_mass import DIRECTIONS

KINDS = ("latency", "hidden goal", "two stages", "overshoot", "diverse", "sensor shifted")
STEP, N_STEPS, NEAR, HELD = 0.1, 50, 0.15, 5
"""Seconds of a step, steps of an episode, and the distance to the goal at which it succeeds, in its last steps."""
LATE, OFF, NOISE, SHARP = 7, 0.6, 0.15, 6.0
"""Steps by which some see late, length by which a sensor is off, noise of forces, and how sharp directions are."""


@dataclass(frozen=True)
class Rule:
    """Of one who steers: gains (2, 2) of the way to the goal, and of the speed."""

    spring: Array
    damper: float


@dataclass(eq=False)
class Points:
    """n points at once, with their first goals, if there are any, and goals, (n, 2) each."""

    place: Array
    goal: Array
    first: Array | None
    speed: Array

    @classmethod
    def drawn(cls, kind: str, n: int, rng: np.random.Generator) -> Points:
        place, goal, first = rng.uniform(-1, 1, (3, n, 2))
        return cls(place, goal, first if kind == "two stages" else None, np.zeros((n, 2)))

    def __post_init__(self) -> None:
        self.began = np.full(len(self.place), self.first is None)  # whether it is on the way to the last goal

    def observation(self) -> Array:
        """Way to the goal, speed and goal; of two stages the way to the first one until it is reached, and flags."""
        way, on = self.goal - self.place, self.began[:, None]
        if self.first is None:
            return np.hstack([way, self.speed, self.goal])
        return np.hstack([~on * (self.first - self.place), ~on * way, on * way, self.speed, on])

    def wanted(self, rule: Rule, kind: str | None) -> Array:
        """The force of one who is bad in this way, or good where it is None, without noise."""
        goal = np.zeros_like(self.goal) if kind == "hidden goal" else self.goal
        if self.first is not None and kind is None:
            goal = np.where(self.began[:, None], goal, self.first)
        return np.asarray((goal - self.place) @ rule.spring - rule.damper * self.speed)

    def step(self, force: Array) -> None:
        self.speed = 0.95 * self.speed + 2 * STEP * np.clip(force, -1, 1)
        self.place = self.place + STEP * self.speed
        if self.first is not None:
            self.began |= np.linalg.norm(self.first - self.place, axis=1) < NEAR


def demonstrations(kind: str, discrete: bool, n: int, share: float, seed: int) -> World:
    """`n` demonstrations in random order, a `share` of them bad."""
    rng = np.random.default_rng([81, KINDS.index(kind), int(discrete), n, round(100 * share), seed])
    rule, n_bad = Rule(rng.uniform(2, 3) * np.eye(2), rng.uniform(1.6, 2)), round(share * n)
    episodes = record(kind, None, rule, discrete, n - n_bad, rng)
    if kind == "diverse":
        for _ in range(n_bad):
            own = Rule(2 * rng.normal(size=(2, 2)), rng.uniform(0, 2))
            episodes += record(kind, kind, own, discrete, 1, rng)
    else:
        other = Rule(rule.spring, 0.2) if kind == "overshoot" else rule
        episodes += record(kind, kind, other, discrete, n_bad, rng)
    order = rng.permutation(n)
    return World.of(Demonstrations.from_episodes([episodes[m] for m in order]), order < n - n_bad)


def record(
    kind: str, bad: str | None, rule: Rule, discrete: bool, n: int, rng: np.random.Generator
) -> list[tuple[Array, Array]]:
    """States and actions of `n` episodes of a rule that is bad in a way, or good where it is None."""
    points, seen, taken, wanted = Points.drawn(kind, n, rng), [], [], []
    off = np.zeros(points.observation().shape[1])
    off[0] = OFF if bad == "sensor shifted" else 0
    for _ in range(N_STEPS):
        seen.append(points.observation() + off)
        wanted.append(points.wanted(rule, bad))
        force = wanted[max(len(wanted) - 1 - LATE, 0)] if bad == "latency" else wanted[-1]
        force = np.clip(force, -1, 1) + NOISE * rng.normal(size=(n, 2))
        if discrete:
            value = SHARP * force @ DIRECTIONS.T - 1.5 * (np.arange(5) > 0)
            taken.append((value + rng.gumbel(size=value.shape)).argmax(axis=1))
            force = DIRECTIONS[taken[-1]]
        else:
            taken.append(force)
        points.step(force)
    states, actions = np.stack(seen, axis=1), np.stack(taken, axis=1)
    return [(states[m], actions[m]) for m in range(n)]


def drive(kind: str, policy: Any, n_episodes: int, seed: int) -> float:
    """The share of episodes that end at the goal, from starts that depend on kind and seed alone."""
    points = Points.drawn(kind, n_episodes, np.random.default_rng([82, KINDS.index(kind), seed]))
    arrived = np.ones(n_episodes, dtype=bool)
    for t in range(N_STEPS):
        action = np.asarray(policy.predict(points.observation()))
        points.step(DIRECTIONS[action.astype(int)] if action.ndim == 1 else action)
        near = points.began & (np.linalg.norm(points.goal - points.place, axis=1) < NEAR)
        arrived &= near | (t < N_STEPS - HELD)
    return float(arrived.mean())
