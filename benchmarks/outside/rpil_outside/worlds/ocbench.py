"""Place things by oracles whose acts are sometimes mistakes, which later acts mend: OCBench.

Source: the package ocbench (MuJoCo on the CPU). Licence: MIT. Published: nothing of finding the mistakes that we know.

A cell names a task and the probability that an act is a mistake: another place than the task needs. A demonstration
with a mistake is bad, and the steps of a wrong act are. At probability 0 all are good, and no AUROC can be taken. This
world measures the AUROC alone: the network, cloned from 60 episodes without mistakes, placed the blocks in none of six
drives.
"""

from __future__ import annotations

import warnings
from itertools import product
from typing import Any

import numpy as np

from rpil_outside.made import laid_out
from rpil_outside.world import Made

TASKS = {
    "block": "block-cpu-lite-double-task1-v0",
    "hanoi": "hanoi-cpu-lite-double-task1-v0",
    "chamber": "chamber-cpu-lite-easy-task1-v0",
}
MISTAKES = ("0", "0.1", "0.5")


def recorded(env: Any, oracle: Any, seed: int) -> tuple[Any, list[dict[str, Any]], bool]:
    """Return an episode, its acts, and whether it succeeded; it ends by the task, by a failure or by the limit."""
    rows, acts = [], []
    observation, info = env.reset(seed=seed)
    oracle.reset(observation, info)
    while True:
        action = oracle.select_action(observation, info)
        if oracle.done:
            break
        rows.append(np.asarray(observation, dtype=np.float32))
        acts.append(np.asarray(action, dtype=np.float32))
        observation, _, ended, late, info = env.step(action)
        if ended or late:
            break
    oracle.finish_episode(len(rows) - 1, info)
    return (np.array(rows), np.array(acts)), oracle.segments, bool(env.unwrapped._success)


def made(cell: str, seed: int, n: int) -> Made:
    """Record `n` episodes; minutes of one core for 50."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a display, which nothing here needs
        import ocbench
        from ocbench import oracles

        task, p_mistake = cell.split()
        env = ocbench.make(TASKS[task], visualize_info=False)
    oracle = getattr(oracles, f"{task.title()}Controller")(env, p_mistake=float(p_mistake))
    rng = np.random.default_rng([seed, OCBench.cells.index(cell), 10])
    before = np.random.get_state()  # noqa: NPY002 (oracles draw from NumPy's own stream)
    np.random.seed(int(rng.integers(2**31)))  # noqa: NPY002
    episodes, good_steps, success = [], [], []
    for _ in range(n):
        episode, acts, done = recorded(env, oracle, int(rng.integers(2**31)))
        fine = np.ones(len(episode[0]), dtype=bool)
        for act in acts:
            if act["is_potential_high_level_mistake"]:
                fine[act["start"] : act["end"] + 1] = False
        episodes.append(episode)
        good_steps.append(fine)
        success.append(done)
    np.random.set_state(before)  # noqa: NPY002
    good = np.array([fine.all() for fine in good_steps])
    return laid_out(episodes, good, np.array(success), good_steps, rng)


class OCBench:
    """Three tasks by three probabilities."""

    name = "ocbench"
    source = "ocbench (PyPI)"
    licence = "MIT"
    published = "nothing of finding mistakes"
    cells = tuple(f"{task} {p_mistake}" for task, p_mistake in product(TASKS, MISTAKES))
    needs: tuple[str, ...] = ("ocbench",)
    whole = 100.0

    def make(self, cell: str, seed: int, quick: bool) -> Made:
        """Record 50 demonstrations, or 6."""
        return made(cell, seed, 6 if quick else 50)

    def drive(self, cell: str, made: Made, weights: np.ndarray, seed: int, quick: bool) -> float:
        """Return NaN: nothing is driven."""
        return float("nan")
