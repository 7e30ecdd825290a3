"""Worlds of a point mass, to break the verdicts of an audit: kinds of operators that no constant was chosen on.

A mass in a plane goes to a goal, past an obstacle. In worlds of `BAD` operators some demonstrations are bad; in worlds
of `GOOD` operators all are good, though not alike, and nobody should be called an outlier. Actions are forces,
or one of five directions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rpil.data.demonstrations import Demonstrations
from worlds import Array, World

STEP, TIME_LIMIT, REACHED = 0.1, 120, 0.15
DIRECTIONS = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
SIZES = ((20, 3), (20, 6), (40, 12), (40, 24))
"""Demonstrations, and how many of them are by the other operator."""


@dataclass(frozen=True)
class Operator:
    """One who drives the mass: a spring to the goal, a damper, and a push away from the obstacle."""

    gain: float = 1.5
    damping: float = 1.6
    side: float = 1.0
    """Of the obstacle on which the mass passes: 1 left, -1 right."""
    noise: float = 0.1
    delay: int = 0
    smoothing: float = 0.0
    """Share of the last action in the next one."""
    mirror: tuple[float, float] = (1.0, 1.0)
    offset: float = 0.0
    """Distance of the aim from the goal."""
    stops: float = 2.0
    """Share of the time limit after which nothing is done."""
    pauses: float = 0.0
    """Probability that a step begins a pause of ten steps."""
    cycle: float = 0.0
    """Radius of a circle around the goal that is followed in place of the goal."""
    hard: bool = False
    """Full force in the direction of the force."""
    start: float = 0.0
    """Displacement of the first position."""
    heed: float = 1.0
    """Share of the steps in which the state is looked at; random actions in the others."""

    def force(self, position: Array, speed: Array, goal: Array, t: int) -> Array:
        """The force (2,) without noise."""
        aim = goal + self.offset * np.array([1.0, -1.0])
        if self.cycle:
            aim = goal + self.cycle * np.array([np.cos(0.3 * t), np.sin(0.3 * t)])
        away = position - 0.5 * goal
        push = self.side * np.array([-away[1], away[0]]) + 0.5 * away
        wanted = self.gain * (aim - position) - self.damping * speed + 1.5 * push * np.exp(-4 * away @ away)
        return np.asarray(np.sign(wanted) if self.hard else np.tanh(wanted)) * np.array(self.mirror)


NORMAL = Operator()
BAD = {
    "stuck": replace(NORMAL, stops=0.15),
    "timid": replace(NORMAL, gain=0.5, damping=1.2),
    "smooth": replace(NORMAL, smoothing=0.9),
    "cyclic": replace(NORMAL, cycle=0.8),
    "noise": replace(NORMAL, noise=0.8),
    "late": replace(NORMAL, delay=6),
    "wrong goal": replace(NORMAL, offset=0.8),
    "flip": replace(NORMAL, mirror=(1.0, -1.0)),
    "random": replace(NORMAL, heed=0.0),
    "half random": replace(NORMAL, heed=0.5),
    "pauses": replace(NORMAL, pauses=0.06),
}
GOOD = {
    "alike": NORMAL,
    "sessions": replace(NORMAL, gain=1.9),
    "calm": replace(NORMAL, gain=1.1),
    "damped": replace(NORMAL, damping=2.4),
    "other side": replace(NORMAL, side=-1.0),
    "hard": replace(NORMAL, hard=True),
    "other start": replace(NORMAL, start=2.0),
    "noisier": replace(NORMAL, noise=0.2),
    "steadier": replace(NORMAL, noise=0.03),
    "slightly late": replace(NORMAL, delay=1),
}
ALL_DIFFER = ("people", "all hard", "half looks")
"""Worlds of good operators in which no two are alike, or all follow one law that is not linear."""


def drive(operator: Operator, discrete: bool, rng: np.random.Generator) -> tuple[Array, Array]:
    """States (N, 6) and actions (N, 2) or (N,) of one demonstration."""
    angle = rng.uniform(0, 2 * np.pi)
    position = 0.5 * rng.normal(size=2) + operator.start
    speed, goal = np.zeros(2), position + 3 * np.array([np.cos(angle), np.sin(angle)])
    states, actions, last, pause = [], [], np.zeros(2), 0
    forces = [np.zeros(2)] * (operator.delay + 1)
    for t in range(TIME_LIMIT):
        states.append(np.concatenate([position, speed, goal - position]))
        forces.append(operator.force(position, speed, goal, t))
        wanted = (1 - operator.smoothing) * forces[-1 - operator.delay] + operator.smoothing * last
        wanted = wanted if rng.random() < operator.heed else rng.uniform(-1, 1, size=2)
        pause = 10 if rng.random() < operator.pauses else pause - 1
        if pause > 0 or t > operator.stops * TIME_LIMIT:
            wanted = np.zeros(2)
        last = np.clip(wanted + operator.noise * rng.normal(size=2), -1, 1)
        if discrete:
            value = 6 * DIRECTIONS @ last - 1.5 * (np.arange(5) > 0)
            chosen = int(np.argmax(value + rng.gumbel(size=5)))
            last = DIRECTIONS[chosen]
        actions.append(chosen if discrete else last)
        speed = 0.95 * speed + STEP * 2 * last
        position = position + STEP * speed
        if np.linalg.norm(goal - position) < REACHED and t > 20:
            break
    return np.array(states), np.array(actions)


def point_mass(kind: str, discrete: bool, size: tuple[int, int], seed: int) -> World:
    """Demonstrations in random order."""
    rng = np.random.default_rng([11, seed, size[0], size[1], int(discrete)])
    total, others = size
    operators = [NORMAL] * (total - others)
    if kind == "people":
        draws = rng.lognormal(sigma=0.25, size=(total, 3))
        operators = [Operator(1.5 * g, 1.6 * d, noise=0.1 * n) for g, d, n in draws]
    elif kind in ALL_DIFFER:
        same = replace(NORMAL, hard=kind == "all hard", heed=0.5 if kind == "half looks" else 1.0)
        operators = [same] * total
    else:
        operators += [(BAD | GOOD)[kind]] * others
    places = rng.permutation(total)
    episodes = [drive(operators[m], discrete, rng) for m in places]
    good = [kind not in BAD or m < total - others for m in places]
    return World.of(Demonstrations.from_episodes(episodes), good)
