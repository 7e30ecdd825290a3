"""Worlds in which demonstrations are made and policies are driven: Meta-World's arm, a disc that is pushed, games.

The quality of a demonstration is the operator's who gave it; its success is how the episode ended.
"""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np

import more_experts  # noqa: F401 (makes these known)
from rpil import rollout, simulate
from rpil.data.demonstrations import Demonstrations
from rpil.numerics.types import Array
from rpil.simulation.simulate import BAD_KINDS
from value import pushing
from value.operators import BAD, GOOD, Operator

Episode = tuple[Array, Array]
Made = tuple[list[Episode], list[str], list[bool]]
NO_GRASP = ("reach", "door-open", "drawer-open", "button-press-topdown", "window-open")
ARM_TASKS = (*NO_GRASP, "push", "pick-place", "peg-insert-side")
OTHER_ARM_TASKS = (
    *("door-close", "window-close", "faucet-open", "plate-slide"),
    *("coffee-button", "push-wall", "sweep-into", "hammer"),
)
"""Nothing in the library or in its benchmarks was chosen on these; they are driven once."""
GAMES = {
    "CartPole-v1": (0, 475),
    "MountainCar-v0": (-200, -110),
    "Acrobot-v1": (-500, -100),
    "LunarLander-v3": (-200, 200),
    "LunarLanderContinuous-v3": (-200, 200),
    "Pendulum-v1": (-1200, -200),
}
"""The return of a policy that does nothing useful, about, and that from which Gymnasium calls a game solved; of the
pendulum, for which it names none, a little less than its expert's."""
IDLE = "idle "
"""Tasks of this name have demonstrations that wait before and after the task, and are the same else."""
WAIT = 20
"""Steps at most of each wait."""
DISC = "disc "
"""Tasks of this name are those of `pushing.MIXTURES`."""
DISC_TASKS = tuple(DISC + mixture for mixture in pushing.MIXTURES)
IDLE_TASKS = tuple(IDLE + task for task in ("reach", "push", "pick-place", "drawer-open"))
TASKS = (*ARM_TASKS, *OTHER_ARM_TASKS, *IDLE_TASKS, *GAMES, *DISC_TASKS)
OLDER_TASKS = (*ARM_TASKS, *IDLE_TASKS, *GAMES)
"""Those that are driven where none are named."""
FAMILIES = ("arm", "other arm", "idle arm", "games", "disc")
KINDS_OF_A_WORLD = 3
"""Kinds of bad demonstrations in one data set, as of a few operators."""
GENTLE = 0.3
"""Share of the good demonstrations of the arm."""
DEMONSTRATION_LIMIT, DRIVE_LIMIT = 250, 200
"""Steps of the arm at most."""
AFTER_SUCCESS = 5
"""Steps that are recorded after it."""
TRIES = 10
"""A good operator who fails begins again, at most so many times."""


@dataclass(frozen=True, eq=False)
class World:
    """M demonstrations and what is known of them."""

    demonstrations: Demonstrations
    is_good: Array
    """(M,) bool."""
    success: Array
    """(M,) bool."""
    kinds: tuple[str, ...]
    """Of the operator of each."""


def family(task: str) -> str:
    of_tasks = zip(FAMILIES, (ARM_TASKS, OTHER_ARM_TASKS, IDLE_TASKS, GAMES, DISC_TASKS), strict=True)
    return next(name for name, tasks in of_tasks if task in tasks)


def make_world(task: str, n: int, share_bad: float, seed: int) -> World:
    """`n` demonstrations in random order, `share_bad` of them bad: of three kinds that the seed draws, or of the
    others of a mixture of drivers, who are good where their kind is."""
    waits, task = task.startswith(IDLE), task.removeprefix(IDLE)
    rng = np.random.default_rng([seed, zlib.crc32(task.encode())])
    n_bad = round(n * share_bad)
    episodes, kinds, success = RECORDED.get(family(task), _arm_demonstrations)(task, n - n_bad, n_bad, rng)
    order = rng.permutation(n)
    is_good = np.array([m < n - n_bad or kinds[m] in pushing.GOOD for m in range(n)])[order]
    if waits:
        episodes = [waiting(episode, rng.integers(WAIT + 1, size=2)) for episode in episodes]
    demonstrations = Demonstrations.from_episodes([episodes[m] for m in order])
    return World(demonstrations, is_good, np.array(success)[order], tuple(kinds[m] for m in order))


def waiting(episode: Episode, steps: Array) -> Episode:
    """With so many steps before and after in which nothing is done and nothing moves."""
    observations, actions = episode
    return np.pad(observations, (steps, (0, 0)), mode="edge"), np.pad(actions, (steps, (0, 0)))


def drive(task: str, policy: Any, n_episodes: int, seed: int) -> tuple[Array, float | None]:
    """Drive a policy from `n_episodes` starts that depend on the task and the seed alone, and on none of the data.

    Returns the success of each, from 0 to 1 (of a game the return between those of `GAMES`), and the mean steps, where
    they are counted.
    """
    if task.startswith(DISC):
        return pushing.drive(policy, n_episodes, seed), None
    if task in GAMES:
        found = rollout(policy, task, n_episodes=n_episodes, seed=seed + 1_000_000)
        return scaled_return(task, found.returns), None
    ended = [_drive_arm(task.removeprefix(IDLE), policy, 1_000_000 + 1000 * seed + k) for k in range(n_episodes)]
    return np.array([success for success, _ in ended]), float(np.mean([steps for _, steps in ended]))


# ---- games -----------------------------------------------------------------------------------------------------------


def scaled_return(task: str, returns: Array) -> Array:
    """0 for a useless return and less, 1 for that of a solved game and more."""
    useless, solved = GAMES[task]
    return np.clip((returns - useless) / (solved - useless), 0, 1)


def _game_demonstrations(task: str, n_good: int, n_bad: int, rng: np.random.Generator) -> Made:
    """The library's expert, and corruptions of it. An outcome is that of the episode as it was played, before most
    corruptions: one who knows outcomes knows little here."""
    kinds = sorted(rng.choice(BAD_KINDS, KINDS_OF_A_WORLD, replace=False).tolist())
    seeds = rng.integers(2**31, size=1 + len(kinds)).tolist()
    counts = np.bincount(np.arange(n_bad) % len(kinds), minlength=len(kinds)).tolist()
    parts = [("expert", simulate(task, kinds[0], n_good=n_good, n_bad=0, seed=seeds[0]))] if n_good else []
    for kind, count, seed in zip(kinds, counts, seeds[1:], strict=True):
        if count:
            parts.append((kind, simulate(task, kind, n_good=0, n_bad=count, seed=seed)))
    episodes = [episode for _, part in parts for episode in part.episodes]
    names = [name for name, part in parts for _ in part.episodes]
    success = [value > 0.5 for _, part in parts for value in scaled_return(task, part.returns).tolist()]
    return episodes, names, success


# ---- Meta-World ------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=2)
def _arm(task: str) -> tuple[Any, Callable[[], Any]]:
    """The environment of a task, whose goal the seed of each reset draws, and its script."""
    from gymnasium import Wrapper
    from metaworld.env_dict import ALL_V3_ENVIRONMENTS_GOAL_OBSERVABLE as TASKS
    from metaworld.policies import ENV_POLICY_MAP

    class Arm(Wrapper):
        """Meta-World itself ignores the seed of a reset."""

        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict]:
            if seed is not None:
                env.seed(seed)
            return self.env.reset(options=options)

    env = TASKS[f"{task}-v3-goal-observable"](seed=0)
    env._freeze_rand_vec = False  # a new goal at each reset ...
    env.seeded_rand_vec = True  # ... that comes from the seed, and not from NumPy's global stream
    return Arm(env), ENV_POLICY_MAP[f"{task}-v3"]


def _arm_demonstrations(task: str, n_good: int, n_bad: int, rng: np.random.Generator) -> Made:
    kinds = rng.choice(list(BAD), KINDS_OF_A_WORLD, replace=False).tolist()
    angle = rng.uniform(0, 2 * np.pi)
    side = np.array([np.cos(angle), np.sin(angle), 0])
    good = ["gentle" if gentle else "normal" for gentle in rng.random(n_good) < GENTLE]
    names = good + [kinds[m % len(kinds)] for m in range(n_bad)]
    episodes, success = [], []
    for m, name in enumerate(names):
        for _ in range(TRIES if m < n_good else 1):
            own, seed = rng.spawn(1)[0], int(rng.integers(900_000))
            episode, succeeded = record_arm(task, partial(Operator, (GOOD | BAD)[name], side=side, rng=own), seed)
            if succeeded:
                break
        episodes.append(episode)
        success.append(succeeded)
    return episodes, names, success


def record_arm(task: str, employed: Callable[[Any], Operator], seed: int) -> tuple[Episode, bool]:
    """One episode of the operator that is `employed` with the script, and whether it succeeded."""
    env, script = _arm(task)
    observation, _ = env.reset(seed=seed)
    observations, actions, since = [], [], -1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # scripts say that they ask for more than 1
        operator = employed(script())
        for n in range(DEMONSTRATION_LIMIT):
            if operator.stops(n) or since == AFTER_SUCCESS:
                break
            action = operator.act(observation, n)
            observations.append(observation)
            actions.append(action)
            observation, _, _, _, info = env.step(action)
            since = since + 1 if since >= 0 or info["success"] else -1
    return (np.array(observations), np.array(actions)), since >= 0


def _disc_demonstrations(task: str, n_usual: int, n_others: int, rng: np.random.Generator) -> Made:
    return pushing.demonstrations(task.removeprefix(DISC), n_usual, n_others, rng)


RECORDED = {"games": _game_demonstrations, "disc": _disc_demonstrations}
"""What records demonstrations of a family that is not of the arm: of a task, so many good ones and so many others."""


def _drive_arm(task: str, policy: Any, seed: int) -> tuple[bool, int]:
    """Whether the policy succeeds, and after how many steps."""
    env, _ = _arm(task)
    observation, _ = env.reset(seed=seed)
    for n in range(DRIVE_LIMIT):
        action = np.clip(policy.predict(observation[None])[0], -1, 1)
        observation, _, _, _, info = env.step(action)
        if info["success"]:
            return True, n + 1
    return False, DRIVE_LIMIT
