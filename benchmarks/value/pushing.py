"""A point pushes a disc to a goal: episodes of good and bad kinds, and policies that are driven, all at once.

Two numbers move the point, at most `SPEED` a step. Where it touches the disc, the disc gives way. An episode succeeds
where the disc is within `NEAR` of the goal. A careful driver goes round the disc, and pushes from behind it. A careless
one runs at the disc: a simpler rule, which succeeds where point, disc and goal happen to lie in a line; of its episodes
only the successful ones are recorded, as of a crowd worker who is paid for successes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rpil.numerics.types import Array

SPEED, TOUCH, NEAR, BEHIND = 0.04, 0.15, 0.12, 0.22
"""Lengths; the table is 2 wide."""
TURN = 1.8
"""Radians by which the way to the disc differs from that of the disc, at most."""
LIMIT, AFTER_SUCCESS = 120, 2
"""Steps of an episode at most, and those that are recorded after its success."""


@dataclass(frozen=True)
class Driver:
    """How a driver differs from the careful one."""

    careless: bool = False
    side: int = 0
    """1 goes round the disc to the left, -1 to the right, 0 by the shorter way."""
    speed: float = 1.0
    tremor: float = 0.05
    """Standard deviation of what is added to each number of an action."""
    stops: tuple[float, float] | None = None
    """Stands still from a step on, which is drawn between these shares of `LIMIT`."""
    shy: float = 0.0
    """Share of the speed that is lost near the disc."""
    aside: float = 0.0
    """Length by which the goal seems to be to one side."""
    random: bool = False
    must_succeed: bool = True
    """Whether only successful episodes are recorded."""


GOOD = {
    "careful": Driver(),
    "other way": Driver(side=-1),
    "quick": Driver(tremor=0.03),
    "steady": Driver(speed=0.75, tremor=0.03),
    "shaky": Driver(speed=0.95, tremor=0.12),
    "wide": Driver(side=1, speed=0.85, tremor=0.06),
}
BAD = {
    "careless": Driver(careless=True),
    "timid": Driver(shy=0.9, must_succeed=False),
    "stuck": Driver(stops=(0.02, 0.2), must_succeed=False),
    "slow": Driver(speed=0.4, must_succeed=False),
    "noisy": Driver(tremor=0.8, must_succeed=False),
    "beside": Driver(aside=0.25, must_succeed=False),
    "random": Driver(random=True, must_succeed=False),
}
DRIVERS = GOOD | BAD


@dataclass(frozen=True)
class Mixture:
    """Who drives in a data set: the usual drivers, and a share of others, of whom the seed draws one kind."""

    usual: tuple[str, ...]
    others: tuple[str, ...]


OPERATORS = ("quick", "steady", "shaky", "wide")
CLUMSY = ("noisy", "beside", "random")
MIXTURES = {
    "careless": Mixture(("careful",), ("careless",)),
    "second way": Mixture(("careful",), ("other way",)),
    "timid": Mixture(("careful",), ("timid",)),
    "stuck": Mixture(("careful",), ("stuck",)),
    "slow": Mixture(("careful",), ("slow",)),
    "two operators": Mixture(OPERATORS[:2], CLUMSY),
    "three operators": Mixture(OPERATORS[:3], CLUMSY),
    "four operators": Mixture(OPERATORS, CLUMSY),
}
"""The second way is as good as the first. Of operators all are good where the share of others is 0."""


@dataclass(eq=False)
class Table:
    """n tables at once: points, discs and goals, (n, 2) each."""

    point: Array
    disc: Array
    goal: Array

    @classmethod
    def drawn(cls, n: int, rng: np.random.Generator) -> Table:
        """Discs in the middle, goals and points anywhere that is not too near."""
        disc = rng.uniform(-0.3, 0.3, size=(n, 2))
        way = rng.uniform(0, 2 * np.pi, n)
        goal = disc + rng.uniform(0.4, 0.8, (n, 1)) * ahead(way)
        point = disc - rng.uniform(0.3, 0.7, (n, 1)) * ahead(way + rng.uniform(-TURN, TURN, n))
        return cls(point, disc, goal)

    def observation(self) -> Array:
        """Ten numbers each."""
        return np.hstack([self.point, self.disc, self.goal, self.disc - self.point, self.goal - self.disc])

    def step(self, action: Array) -> None:
        """Move the points, and the discs that they touch."""
        length = np.linalg.norm(action, axis=1, keepdims=True)
        self.point = self.point + SPEED * action / np.maximum(length, 1.0)
        away = self.disc - self.point
        distance = np.linalg.norm(away, axis=1, keepdims=True)
        pushed = self.point + TOUCH * away / np.maximum(distance, 1e-9)
        self.disc = np.where(distance < TOUCH, pushed, self.disc)

    def succeeded(self) -> Array:
        return np.linalg.norm(self.goal - self.disc, axis=1) < NEAR


def ahead(angle: Array) -> Array:
    return np.column_stack([np.cos(angle), np.sin(angle)])


def unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)


def careful(table: Table, goal: Array, side: int) -> Array:
    """The direction of a careful driver: to the point behind the disc, round the disc where it is in the way, and on to
    the goal as far as the point is behind the disc."""
    push = unit(goal - table.disc)
    across = np.column_stack([-push[:, 1], push[:, 0]])
    from_disc = table.point - table.disc
    distance = np.linalg.norm(from_disc, axis=1, keepdims=True)
    beside = (from_disc * across).sum(axis=1, keepdims=True)
    before = (from_disc * push).sum(axis=1, keepdims=True)
    turn = np.full((len(push), 1), side) if side else np.where(beside >= 0, 1.0, -1.0)
    wide = turn * BEHIND * np.clip(1 + before / BEHIND, 0, 1.3)  # where it is not behind the disc yet, it stays beside
    place = table.disc - BEHIND * push + wide * across
    aligned = np.clip(2 - np.abs(beside) / (0.3 * TOUCH), 0, 1) * np.clip(-before / (0.5 * TOUCH), 0, 1)
    away = np.clip(1.15 * TOUCH - distance, 0, None) / TOUCH * (1 - aligned) * unit(from_disc)
    to_place = np.clip((place - table.point) / 0.15, -1, 1)
    forward = push - 2 * beside / TOUCH * across
    return unit(aligned * forward + (1 - aligned) * to_place + 3 * away)


def driven(table: Table, driver: Driver, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    """Observations (n, T, 10), actions (n, T, 2), the number of steps and the success of each."""
    n = len(table.point)
    shift = driver.aside * ahead(rng.uniform(0, 2 * np.pi, n))
    stop = rng.uniform(*(LIMIT * np.array(driver.stops)), n) if driver.stops else np.full(n, np.inf)
    seen, done, since = [], [], np.full(n, -1)
    lengths = np.full(n, LIMIT)
    for t in range(LIMIT):
        way = unit(table.disc - table.point) if driver.careless else careful(table, table.goal + shift, driver.side)
        if driver.random:
            way = rng.uniform(-1, 1, size=(n, 2))
        near = np.linalg.norm(table.disc - table.point, axis=1) < 2 * TOUCH
        gain = driver.speed * (1 - driver.shy * near) * (t < stop)
        action = np.clip(gain[:, None] * way + driver.tremor * rng.normal(size=(n, 2)) * (t < stop)[:, None], -1, 1)
        seen.append(table.observation())
        done.append(action)
        table.step(action)
        since = np.where((since >= 0) | table.succeeded(), since + 1, since)
        lengths = np.where((since == AFTER_SUCCESS) & (lengths == LIMIT), t + 1, lengths)
    return np.stack(seen, axis=1), np.stack(done, axis=1), lengths, since >= 0


def demonstrations(
    mixture: str, n_usual: int, n_others: int, rng: np.random.Generator
) -> tuple[list[tuple[Array, Array]], list[str], list[bool]]:
    """Episodes of the usual drivers and then of the others: the kind of each, and whether it succeeded."""
    usual, others = MIXTURES[mixture].usual, MIXTURES[mixture].others
    names = [usual[m % len(usual)] for m in range(n_usual)] + [str(rng.choice(others))] * n_others
    episodes: list[tuple[Array, Array]] = []
    success: list[bool] = []
    for name in dict.fromkeys(names):
        recorded, succeeded = record(DRIVERS[name], names.count(name), rng)
        episodes += recorded
        success += succeeded
    return episodes, sorted(names, key=names.index), success


def record(driver: Driver, n: int, rng: np.random.Generator) -> tuple[list[tuple[Array, Array]], list[bool]]:
    """`n` episodes of a driver, and whether each succeeded."""
    episodes: list[tuple[Array, Array]] = []
    success: list[bool] = []
    while len(episodes) < n:
        seen, done, lengths, reached = driven(Table.drawn(4 * n + 20, rng), driver, rng)
        for m in np.flatnonzero(reached | (not driver.must_succeed)).tolist()[: n - len(episodes)]:
            episodes.append((seen[m, : lengths[m]], done[m, : lengths[m]]))
            success.append(bool(reached[m]))
    return episodes, success


def drive(policy: Any, n_episodes: int, seed: int) -> Array:
    """Whether each of `n_episodes` succeeds, from starts that depend on the seed alone."""
    table, reached = Table.drawn(n_episodes, np.random.default_rng([seed, 1_000_000])), np.zeros(n_episodes, dtype=bool)
    for _ in range(LIMIT):
        table.step(np.clip(policy.predict(table.observation()), -1, 1))
        reached |= table.succeeded()
    return reached
