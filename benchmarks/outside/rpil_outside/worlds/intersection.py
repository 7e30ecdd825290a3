"""Cross an intersection before or behind another car, after noisy teachers: the Intersection of Counter-BC.

Source: Sagheb and Losey, "Counterfactual behavior cloning", arXiv 2505.10760. Licence: their code has none, and nothing
of it is here: the world is written from the description of the same group's Intersection (Stable-BC): the state is the
place of both cars, the action the velocity of one, and a step earns the progress to the goal and 0.75 of what the
distance to the other car grows by. Published return: BC 4.0, ILEED 4.2, BCND 8.5, Counter-BC 13.0. Start, speed,
noise and number of steps are ours, chosen so that the careful teacher earns about 15, as the best do there: compare the
order of methods, and not a difference of a point.

A cell names the noise of the bad teachers and the number of demonstrations. Half of the teachers are bad: `gaussian`
adds normal noise to each velocity, `uniform` puts a random velocity in place of most, `drift` drives to one side, the
same side in all, and `overshoot` drives on beyond the goal.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from rpil_outside.learners import fit
from rpil_outside.made import laid_out
from rpil_outside.world import Made

GOAL, START, SPREAD = np.array([7.5, 0.0]), np.array([-7.5, 0.0]), 0.5
OTHER_START, OTHER_GOAL = np.array([0.0, -7.5]), np.array([0.0, 7.5])
SPEED, STEPS, APART = 1.0, 25, 0.75
"""Way of a step at most, steps of an episode, and what a unit of distance between the cars is worth."""
TREMOR = 0.05
"""Standard deviation of what a good teacher adds to each number."""
NOISES = ("gaussian", "uniform", "drift", "overshoot")
BEYOND = np.array([8.0, 0.0])
"""How far one who overshoots drives."""
SIZES = (10, 20, 40, 80)


def best(own: np.ndarray, other: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Return the velocities that earn most in the next step: towards the goal, and away from the other car."""
    way, away = goal - own, own - other
    far = np.linalg.norm(way, axis=1, keepdims=True)
    near = np.linalg.norm(away, axis=1, keepdims=True)
    wanted = way / np.maximum(far, 1e-9) + APART * away / np.maximum(near, 1e-9)
    wanted /= np.maximum(np.linalg.norm(wanted, axis=1, keepdims=True), 1e-9)
    arriving = np.clip(far / SPEED, 0, 1)  # it stays at the goal
    return SPEED * (arriving * wanted + (1 - arriving) * way)


def velocity(noise: str, own: np.ndarray, other: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return what teachers of a sort drive."""
    wanted = best(own, other, GOAL + BEYOND if noise == "overshoot" else GOAL)
    n = len(own)
    if noise == "gaussian":
        wanted = wanted + rng.normal(0, 1.2, (n, 2))
    if noise == "uniform":
        wanted = np.where(rng.random((n, 1)) < 0.7, rng.uniform(-1, 1, (n, 2)), wanted)
    if noise == "drift":
        wanted = wanted + np.array([-0.2, -0.8])
    return np.clip(wanted + rng.normal(0, TREMOR, (n, 2)), -SPEED, SPEED)


def crossed(n: int, rng: np.random.Generator, act) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Let n cars drive by `act`, and return what they saw (n, T, 4), their velocities (n, T, 2) and returns (n,)."""
    own = START + rng.uniform(-SPREAD, SPREAD, (n, 2)) * [1, 4]
    other = OTHER_START + rng.uniform(-SPREAD, SPREAD, (n, 2)) * [1, 4]
    seen, done = [], []
    earned = np.linalg.norm(own - GOAL, axis=1) - APART * np.linalg.norm(own - other, axis=1)
    for _ in range(STEPS):
        seen.append(np.hstack([own, other]))
        done.append(np.clip(act(own, other), -SPEED, SPEED))
        reply = best(other, own, OTHER_GOAL)
        own, other = own + done[-1], other + reply
    earned += APART * np.linalg.norm(own - other, axis=1) - np.linalg.norm(own - GOAL, axis=1)
    return np.stack(seen, axis=1), np.stack(done, axis=1), earned


class Intersection:
    """Four sorts of noise by four sizes."""

    name = "intersection"
    source = "Counter-BC, arXiv 2505.10760"
    licence = "none; rewritten from descriptions"
    published = "return: BC 4.0, ILEED 4.2, BCND 8.5, Counter-BC 13.0"
    cells = tuple(f"{noise} {size}" for noise, size in product(NOISES, SIZES))
    needs: tuple[str, ...] = ()
    whole = 15.0

    def make(self, cell: str, seed: int, quick: bool) -> Made:
        """Record as many demonstrations as the cell says, half of them of bad teachers."""
        noise, size = cell.split()
        n, rng = int(size), np.random.default_rng([seed, self.cells.index(cell), 3])
        episodes: list[tuple[np.ndarray, np.ndarray]] = []
        for sort, count in (("none", n - n // 2), (noise, n // 2)):
            seen, done, _ = crossed(count, rng, lambda own, other, sort=sort: velocity(sort, own, other, rng))
            episodes += zip(seen, done, strict=True)
        return laid_out(episodes, np.arange(n) < n - n // 2, None, None, rng)

    def drive(self, cell: str, made: Made, weights: np.ndarray, seed: int, quick: bool) -> float:
        """Return the mean return of 100 cars that the policy drives."""
        data = made.demonstrations
        policy = fit(data.observations, data.actions, weights, seed, steps=400 if quick else 1500)
        rng = np.random.default_rng([seed, 4])
        _, _, earned = crossed(100, rng, lambda own, other: policy.predict(np.hstack([own, other])))
        return float(earned.mean())
