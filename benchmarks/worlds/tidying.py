"""A hand on a plane that puts two things where they belong, with acts that are planted and known row by row.

A state holds the hand (x, y and how far it is closed) and the two things (x, y); an action is a velocity and a command
to the grip. Families plant what a demonstration may have inside: a wrong place that is mended later, an act that is
undone, a try beside the thing, a pause, a policy that a person stops. Others have nothing to find: two ways, slow
people, a target that differs, one that gets stuck.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.demonstrations import Demonstrations
from worlds import Array

PLANTED = "wrong place", "undone", "retry", "takeover", "pause"
CLEAN = "nobody", "two ways", "slow", "own targets", "one order"
TARGETS = np.array([[0.8, 0.2], [0.8, 0.8]])
SPEED, GRIP, REACH = 0.05, 0.34, 0.04
SHARE = 0.3
"""Share of the demonstrations in which something is planted."""


@dataclass(frozen=True, eq=False)
class Tidied:
    """Demonstrations and their truth."""

    demonstrations: Demonstrations
    bad: Array
    """(N,) rows of acts that should not have been."""
    pause: Array
    """(N,) rows of a planted pause."""
    takeover: Array
    """(N,) rows in which a person had taken over."""


class Plane:
    """The world: it records what is done in it."""

    def __init__(self, rng: np.random.Generator, noise: float, start: Array) -> None:
        self.hand, self.grip, self.things = rng.uniform([0.0, 0.0], [0.3, 1.0]), 0.0, start.copy()
        self.held, self.noise, self.rng = -1, noise, rng
        self.rows: list[Array] = []
        self.actions: list[Array] = []
        self.truth: list[tuple[bool, bool, bool]] = []

    def state(self) -> Array:
        clean = np.concatenate([self.hand, [self.grip], self.things.ravel()])
        return np.asarray(clean + self.noise * self.rng.normal(size=len(clean)))

    def step(self, velocity: Array, close: float, truth: tuple[bool, bool, bool]) -> None:
        """Record a row, and do one step."""
        self.rows.append(self.state())
        self.actions.append(np.append(velocity, close))
        self.truth.append(truth)
        self.hand = np.clip(self.hand + velocity, -0.2, 1.2)
        self.grip = float(np.clip(self.grip + GRIP * np.sign(close - 0.5), 0.0, 1.0))
        if self.grip < 0.5:
            self.held = -1
        elif self.held < 0:
            distance = np.linalg.norm(self.things - self.hand, axis=1)
            self.held = int(np.argmin(distance)) if distance.min() < REACH else -2  # -2: closed around nothing
        if self.held >= 0:
            self.things[self.held] = self.hand


@dataclass
class Person:
    """One who acts in a plane, at a speed of their own."""

    plane: Plane
    speed: float
    bend: float
    rng: np.random.Generator

    def go(self, to: Array, close: float, truth: tuple[bool, bool, bool], share: float = 1.0) -> None:
        """Move the hand to a point, in a bend, or a share of the way."""
        start = self.plane.hand.copy()
        way = to - start
        n = max(3, round(float(np.linalg.norm(way)) / (SPEED * self.speed)))
        side = self.bend * np.array([-way[1], way[0]])
        for k in range(max(1, round(share * n))):
            u = (k + 1) / n
            aim = start + u * way + np.sin(np.pi * u) * side
            self.plane.step(aim - self.plane.hand + 0.003 * self.rng.normal(size=2), close, truth)

    def grasp(self, close: float, truth: tuple[bool, bool, bool]) -> None:
        """Close or open the grip."""
        for _ in range(4):
            self.plane.step(0.002 * self.rng.normal(size=2), close, truth)

    def place(self, thing: int, to: Array, truth: tuple[bool, bool, bool] = (False, False, False)) -> None:
        """Put a thing somewhere, and draw back."""
        self.go(self.plane.things[thing] + 0.01 * self.rng.normal(size=2), 0.0, truth)
        self.grasp(1.0, truth)
        self.go(to + 0.015 * self.rng.normal(size=2), 1.0, truth)
        self.grasp(0.0, truth)
        away = np.array([self.rng.uniform(-0.05, 0.05), self.rng.choice([-1, 1]) * self.rng.uniform(0.15, 0.25)])
        self.go(self.plane.hand + away, 0.0, truth)

    def try_beside(self, thing: int) -> None:
        """Close beside a thing, and open again."""
        truth = (True, False, False)
        self.go(self.plane.things[thing] + np.array([0.0, 2.5 * REACH]), 0.0, truth)
        self.grasp(1.0, truth)
        self.go(self.plane.hand + np.array([0.0, 0.1]), 1.0, truth)
        self.grasp(0.0, truth)

    def rest(self, n: int) -> None:
        """Do nothing for a while, whatever is held."""
        for _ in range(n):
            self.plane.step(np.zeros(2), float(self.plane.grip > 0.5), (False, True, False))


def tidied(family: str, n: int, seed: int, noise: float = 0.0, share: float = SHARE, in_order: bool = False) -> Tidied:
    """`n` demonstrations of a family; things may be taken `in_order`, which policies can learn from few."""
    rng = np.random.default_rng([51, seed, (*PLANTED, *CLEAN).index(family)])
    planes = [tidy(family, bool(k < share * n), noise, own, in_order) for k, own in enumerate(rng.spawn(n))]
    planes = [planes[k] for k in rng.permutation(n)]
    truth = np.array([row for plane in planes for row in plane.truth])
    made = Demonstrations.from_episodes([(np.array(p.rows), np.array(p.actions)) for p in planes])
    return Tidied(made, *truth.T)


def tidy(family: str, is_planted: bool, noise: float, rng: np.random.Generator, in_order: bool) -> Plane:
    """One demonstration."""
    plane = Plane(rng, noise, rng.uniform([0.1, 0.05], [0.55, 0.95], size=(2, 2)))
    slow = 0.5 if family == "slow" and is_planted else 1.0
    side = rng.choice([-0.4, 0.4]) if family == "two ways" else rng.normal(0.0, 0.05)
    person = Person(plane, slow * rng.uniform(0.8, 1.2), float(side), rng)
    targets = TARGETS if family != "own targets" else rng.uniform([0.65, 0.05], [1.0, 0.95], size=(2, 2))
    order = [0, 1] if in_order or family == "one order" else rng.permutation(2).tolist()
    at = int(rng.integers(2)) if is_planted else -1
    wrong = (True, False, False)
    for k, thing in enumerate(order):
        elsewhere = rng.uniform([0.1, 0.05], [0.55, 0.95])
        if k == at and family == "wrong place":
            person.place(thing, elsewhere, wrong)
        if k == at and family == "retry":
            person.try_beside(thing)
        if k == at and family == "takeover":
            person.go(plane.things[thing], 0.0, wrong)
            person.grasp(1.0, wrong)
            person.go(elsewhere, 1.0, wrong, share=0.7)
            person.go(targets[thing], 1.0, (False, False, True))
            person.grasp(0.0, (False, False, True))
            continue
        if k == at and family == "pause":
            person.go(plane.things[thing], 0.0, (False, False, False), share=rng.uniform(0.3, 0.7))
            person.rest(int(rng.integers(7, 61)))
        begin = plane.things[thing].copy()
        person.place(thing, targets[thing])
        if k == at and family == "undone":
            person.place(thing, begin, wrong)
            person.place(thing, targets[thing])
    return plane
