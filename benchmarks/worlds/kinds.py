"""Worlds of kinds on which audits failed: good operators who differ, two ways, rules that bend, and small ones."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from rpil.data.demonstrations import Demonstrations
from value import pushing
from worlds import World
from worlds.still import pendulum

SHARES = (25, 50, 75, 90)
"""Percent of the demonstrations by the careless driver, or by the second way."""


def operators(seed: int) -> World:
    """60 to 250 reaches by two to four good operators who differ in speed, height, tremor, and where they begin."""
    rng = np.random.default_rng([21, seed])
    n, n_operators = int(rng.integers(60, 251)), int(rng.integers(2, 5))
    speed, height, tremor, first = (rng.normal(size=n_operators) for _ in range(4))
    who = rng.integers(n_operators, size=n)
    episodes = []
    for u in who.tolist():
        position, goal = rng.normal(size=3) * 0.4, rng.normal(size=3) * 0.4 + np.array([2.0, 0.0, 0.0])
        position[0] += 0.6 * first[u] * (seed % 3 == 0)  # in a third of the worlds operators begin elsewhere
        states, actions = [], []
        for _ in range(80):
            away = goal - position
            via = away + np.array([0.0, 0.0, 0.5 * height[u] * min(1.0, abs(away[0]))])
            action = np.tanh(1.5 * via) * 0.12 * np.exp(0.2 * speed[u])
            action += 0.01 * np.exp(0.7 * tremor[u]) * rng.normal(size=3)
            states.append(np.concatenate([position, goal]))
            actions.append(action)
            position = position + action
            if np.linalg.norm(goal - position) < 0.1:
                break
        episodes.append((np.array(states), np.array(actions)))
    return World.of(Demonstrations.from_episodes(episodes), np.ones(n))


def disc(mixture: str, percent: int, seed: int) -> World:
    """200 demonstrations of a disc that a point pushes; of the second way both are good."""
    rng = np.random.default_rng([22, percent, seed])
    others = 2 * percent
    episodes, names, _ = pushing.demonstrations(mixture, 200 - others, others, rng)
    order = rng.permutation(200)
    good = np.array([name in pushing.GOOD or mixture == "second way" for name in names])
    return World.of(Demonstrations.from_episodes([episodes[m] for m in order]), good[order])


def bent(n_bent: int, seed: int) -> World:
    """60 walks, `n_bent` of them by a good rule that no linear policy expresses, and the others by a linear one."""
    rng = np.random.default_rng([23, n_bent, seed])
    is_bent = rng.permutation(60) < n_bent
    states = [np.cumsum(rng.normal(0, 0.3, (60, 4)), axis=0) for _ in is_bent]
    rules = [np.tanh(s[:, 2:]) * np.sign(s[:, :2]) if own else s[:, :2] for s, own in zip(states, is_bent, strict=True)]
    actions = [rule + rng.normal(0, 0.05, rule.shape) for rule in rules]
    return World.of(Demonstrations.from_episodes(list(zip(states, actions, strict=True))), np.ones(60))


def feeble(seed: int) -> World:
    """Swings of a pendulum, of which one in five is weak and noisy."""
    demonstrations, good, _ = pendulum(seed)
    return World.of(demonstrations, good)


def small(k: int) -> World:
    """6 to 24 demonstrations of 8 to 30 steps, of which some act at random: the first 42 with discrete actions."""
    rng = np.random.default_rng([24, k])
    n, n_columns, noise = int(rng.integers(6, 25)), int(rng.integers(2, 6)), float(rng.uniform(0.1, 1.0))
    weights, good = rng.normal(size=(n_columns, 3)), rng.random(n) >= rng.uniform(0, 0.5)
    episodes = []
    for is_good in good:
        states = rng.normal(size=(int(rng.integers(8, 31)), n_columns))
        values = states @ weights + noise * rng.gumbel(size=(len(states), 3))
        values = values if is_good else rng.gumbel(size=values.shape)
        episodes.append((states, values.argmax(axis=1) if k < 42 else values[:, :2]))
    return World.of(Demonstrations.from_episodes(episodes), good)


def unequal(n: int, bad: str, seed: int) -> World:
    """`n` flights to a place in wind: a third are 10 to 40 steps, and the others up to 800. One in seven is `bad`."""
    rng, episodes = np.random.default_rng([25, n, len(bad), seed]), []
    good = rng.permutation(n) >= (round(n / 7) if bad else 0)
    for m, is_good in enumerate(good):
        place, speed, wind, states, actions = rng.normal(size=3), np.zeros(3), np.zeros(3), [], []
        for _ in range(int(rng.integers(10, 800 if m % 3 else 40))):
            states.append(np.concatenate([place, speed]))
            action = -1.5 * place - 1.2 * speed + (1.0 if bad == "noisy" and not is_good else 0.1) * rng.normal(size=3)
            actions.append(rng.normal(size=3) if bad == "random" and not is_good else action)
            wind = 0.98 * wind + 0.1 * rng.normal(size=3)
            speed = speed + 0.05 * (actions[-1] + wind)
            place = place + 0.05 * speed
        episodes.append((np.array(states), np.array(actions)))
    return World.of(Demonstrations.from_episodes(episodes), good)


KINDS: dict[str, tuple[Callable[..., World], tuple[tuple[object, ...], ...]]] = {
    "operators": (operators, tuple((seed,) for seed in range(50))),
    "careless": (disc, tuple(("careless", percent, seed) for percent in SHARES for seed in range(5))),
    "second way": (disc, tuple(("second way", percent, seed) for percent in SHARES for seed in range(5))),
    "bent rule": (bent, tuple((n, seed) for n in (2, 3, 4, 6, 30) for seed in range(4))),
    "pendulum": (feeble, tuple((seed,) for seed in range(20))),
    "small": (small, tuple((k,) for k in range(62))),
    "unequal": (unequal, tuple(product((20, 40, 80), ("", "noisy", "random"), range(6)))),
}
"""What makes each kind of world, and with what."""
