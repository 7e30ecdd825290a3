"""Follow an instruction in a grid, after demonstrators whose skill depends on the state: BabyAI, ILEED's protocol.

Source: the levels and the bot of BabyAI in the package minigrid; the protocol is that of ILEED (Beliaev et al.,
"Imitation learning by estimating expertise of demonstrators", arXiv 2202.01288). Licence: Apache 2.0. Published of
four other levels, robomimic and chess: ILEED above others in 21 of 23 settings, by 7 % in the mean, 60 % at most.

A demonstrator does what the bot plans, but presses a key by chance with a probability that is his own and depends on
the state: ILEED's skill is the sigmoid of the product of an embedding of the state and a vector of the demonstrator.
Here the embedding is whether what is asked for is in view. Bad demonstrators press by chance in 95 % of the steps where
it is, and in half of those where it is not, or the reverse; good ones in 5 %. A cell names the level and the percentage
that is bad. An episode succeeds where the mission is done within the limit, and it earns what minigrid gives: 100 less
90 times the share of the limit that it took. A step is good where the bot would have done the same.
"""

from __future__ import annotations

import contextlib
import io
from itertools import product
from typing import Any

import numpy as np

from rpil_outside.learners import Network, fit
from rpil_outside.made import laid_out
from rpil_outside.world import Made

LEVELS = {"goto": "BabyAI-GoToRedBallGrey-v0", "pickup": "BabyAI-PickupLoc-v0", "unlock": "BabyAI-UnlockLocal-v0"}
SHARES = (25, 50, 75)
LIMIT, KEYS = 64, 6
"""Steps of an episode at most, and keys: left, right, forward, pick up, drop, toggle."""
GOOD, BAD = (0.05, 0.05), (0.95, 0.5)
"""Probability of a key by chance where what is asked for is in view, and where it is not."""
THINGS, COLOURS, CARRIED = 11, 6, slice(5, 8)
"""Kinds of things, colours, and the things that can be carried."""


def level(cell: str) -> Any:
    """Return the environment of a cell."""
    import gymnasium
    import minigrid  # noqa: F401 (names the levels)

    return gymnasium.make(LEVELS[cell.split()[0]], disable_env_checker=True).unwrapped


def begun(env: Any, seed: int) -> tuple[dict[str, Any], np.ndarray]:
    """Return the first observation, and which things and colours the mission names; of none named, all."""
    from minigrid.core.constants import COLOR_TO_IDX, OBJECT_TO_IDX

    with contextlib.redirect_stdout(io.StringIO()):  # minigrid prints what it tries
        observation = env.reset(seed=seed)[0]
    named = [np.zeros(THINGS), np.zeros(COLOURS)]
    for found, numbers in zip(named, (OBJECT_TO_IDX, COLOR_TO_IDX), strict=True):
        for name, number in numbers.items():
            found[number] = name in observation["mission"]
        if not found.any():
            found[CARRIED if len(found) == THINGS else slice(None)] = 1
    return observation, np.concatenate(named)


def seen(env: Any, observation: dict[str, Any], named: np.ndarray) -> np.ndarray:
    """Return the thing in each cell of the view, a mark on what is asked for, what is open, and what is carried."""
    things, colours, states = np.moveaxis(observation["image"], -1, 0).reshape(3, -1)
    asked = named[things] * named[THINGS + colours]
    carried = env.carrying is not None
    return np.concatenate([asked, np.eye(THINGS)[things].ravel(), (things == 4) * (states == 0), [carried]])


def recorded(env: Any, chance: tuple[float, float], seed: int, rng: np.random.Generator) -> tuple[Any, ...]:
    """Return an episode, whether each key was the bot's, and whether the mission was done."""
    from minigrid.utils.baby_ai_bot import BabyAIBot, DisappearedBoxError

    observation, named = begun(env, seed)
    bot, last, ended, rows, keys, own = BabyAIBot(env), None, False, [], [], []
    while not ended and len(keys) < LIMIT:
        try:
            key = int(bot.replan(last))
        except (AssertionError, DisappearedBoxError):  # the bot is lost where chance led it
            break
        rows.append(seen(env, observation, named))
        in_view = rows[-1][: observation["image"].size // 3].any()
        keys.append(int(rng.integers(KEYS)) if rng.random() < chance[int(not in_view)] else key)
        own.append(keys[-1] == key)
        last = env.actions(keys[-1])
        observation, reward, ended, _, _ = env.step(last)
    return (np.array(rows), np.array(keys)), np.array(own), bool(ended and reward > 0)


def earned(env: Any, policy: Network, seed: int, rng: np.random.Generator) -> float:
    """Drive one episode, and return what it earns."""
    observation, named = begun(env, seed)
    for n in range(LIMIT):
        key = policy.sample(seen(env, observation, named)[None], rng)[0]
        observation, reward, ended, _, _ = env.step(int(key))
        if ended:
            return (100 - 90 * (n + 1) / LIMIT) * bool(reward > 0)
    return 0.0


class BabyAI:
    """Three levels by three shares."""

    name = "babyai"
    source = "minigrid's BabyAI bot; protocol of ILEED, arXiv 2202.01288"
    licence = "Apache 2.0"
    published = "other levels, robomimic, chess: ILEED first in 21 of 23 settings, by 7 % in the mean"
    cells = tuple(f"{name} {share}" for name, share in product(LEVELS, SHARES))
    needs: tuple[str, ...] = ("minigrid",)
    whole = 100.0

    def make(self, cell: str, seed: int, quick: bool) -> Made:
        """Record 200 demonstrations, or 40."""
        env, n = level(cell), 40 if quick else 200
        n_bad, rng = round(n * int(cell.split()[1]) / 100), np.random.default_rng([seed, self.cells.index(cell), 7])
        episodes, good_steps, success = [], [], []
        for m in range(n):
            chance = GOOD if m < n - n_bad else BAD if m % 2 else BAD[::-1]
            while True:  # an episode in which the bot is lost at once holds nothing
                episode, own, done = recorded(env, chance, int(rng.integers(2**31)), rng)
                if len(own) > 1:
                    break
            episodes.append(episode)
            good_steps.append(own)
            success.append(done)
        return laid_out(episodes, np.arange(n) < n - n_bad, np.array(success), good_steps, rng)

    def drive(self, cell: str, made: Made, weights: np.ndarray, seed: int, quick: bool) -> float:
        """Return what the policy earns in the mean, of 100; it draws keys by their probabilities."""
        data, env, n = made.demonstrations, level(cell), 30 if quick else 100
        policy = fit(data.observations, data.actions, weights, seed, steps=300 if quick else 1500, discrete=True)
        starts = np.random.default_rng([seed, 8]).integers(2**31, size=n).tolist()  # the same for every policy
        return sum(earned(env, policy, start, np.random.default_rng([start, 8])) for start in starts) / n
