"""Drive Meta-World's arm by its scripts, as better, okay and worse operators do, or with eleven sorts of faults.

Source: Meta-World 3 (Farama Foundation); better, okay and worse are the operators of robomimic's multi-human sets
(Mandlekar et al., arXiv 2108.03298). Licence: MIT. Published on Meta-World: nothing with such operators.

A cell names a task and `operators` (a third each of better, okay and worse ones: worse ones are bad) or `faults`, of
which the seed draws three sorts for half of the demonstrations. An operator sees an observation, perhaps wrongly, asks
the script for an action, and carries it out, perhaps wrongly. Only a good operator begins again after a failure.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from rpil_outside.learners import fit
from rpil_outside.made import laid_out
from rpil_outside.world import Made

HAND, THING, GOAL = slice(0, 3), slice(4, 7), slice(36, 39)
"""Places in an observation; the hand is also that of the motion in an action."""
TYPICAL, LIMIT, DRIVEN, AFTER = 60, 200, 150, 5
"""Steps that a script needs, about; of a record and of a drive at most; that are recorded after a success."""
TASKS = ("reach", "push", "pick-place", "drawer-open", "door-open", "window-open")
TRIES, SORTS = 10, 3


@dataclass(frozen=True)
class Kind:
    """How an operator differs from the script."""

    gain: float = 1.0
    tremor: float = 0.1
    """Standard deviation of what is added to the motion."""
    aside: float = 0.0
    """Metres by which thing and goal seem to be to one side, the same in a whole set."""
    beyond: float = 0.0
    """Metres by which they seem farther away, up to the middle."""
    delay: int = 0
    """Steps after which an observation is acted on."""
    leaves: tuple[float, float] | None = None
    """Motion upwards and force of the gripper (0: the script's) from the middle on."""
    pauses: int = 0
    strays: int = 0
    """Steps of each of three pauses, or of three detours."""
    mirrored: bool = False
    """Goes to the other side up to the middle."""
    wrong_gripper: bool = False
    limit: int = LIMIT
    """Steps after which the operator is content."""


OPERATORS = {
    "better": Kind(tremor=0.05),
    "okay": Kind(gain=0.7, tremor=0.3),
    "worse": Kind(gain=0.5, tremor=0.5, strays=10, pauses=10),
}
FAULTS = {
    "gives up": Kind(leaves=(0, 0)),
    "drops": Kind(leaves=(0.5, -1)),
    "beside": Kind(aside=0.08, limit=2 * TYPICAL),
    "slow": Kind(gain=0.4),
    "detours": Kind(strays=15),
    "pauses": Kind(pauses=20),
    "overshoots": Kind(beyond=0.06),
    "late": Kind(delay=6),
    "shaky": Kind(tremor=0.8),
    "wrong gripper": Kind(wrong_gripper=True),
    "other order": Kind(mirrored=True),
}


class Operator:
    """Drives one episode."""

    def __init__(self, kind: Kind, script: Any, side: np.ndarray, rng: np.random.Generator) -> None:
        self.kind, self.script, self.side, self.rng = kind, script, side, rng
        self.middle = rng.uniform(0.3, 0.7) * TYPICAL
        self.breaks = rng.uniform(0, TYPICAL, 3)
        self.ways = rng.uniform(-1, 1, (3, 3))
        self.seen: list[np.ndarray] = []

    def act(self, observation: np.ndarray, n: int) -> np.ndarray:
        """Return the action at step n."""
        kind = self.kind
        self.seen.append(observation)
        believed = self.seen[max(n - kind.delay, 0)].copy()
        onward = (self.seen[0][THING] - self.seen[0][HAND]) * [1, 1, 0]
        onward /= max(np.linalg.norm(onward), 1e-6)
        wrong = kind.aside * self.side + kind.beyond * (n < self.middle) * onward
        believed[THING] += wrong
        believed[GOAL] += wrong
        action = np.array(np.clip(self.script.get_action(believed), -1, 1), dtype=float)
        if kind.leaves is not None and n >= self.middle:
            action = np.array([0, 0, kind.leaves[0], kind.leaves[1] or action[3]])
        for start, way in zip(self.breaks, self.ways, strict=True):
            if start <= n < start + kind.strays:
                action[HAND] = way
            elif start + kind.strays <= n < start + kind.strays + kind.pauses:
                action[HAND] = 0
        if kind.mirrored and n < self.middle:
            action[:2] *= -1
        if kind.wrong_gripper and (n // 10) % 2:
            action[3] = -action[3] if action[3] else 1.0
        action[HAND] = kind.gain * action[HAND] + kind.tremor * self.rng.normal(size=3)
        return np.clip(action, -1, 1)

    def stops(self, n: int) -> bool:
        """Return whether the operator ends the episode before step n."""
        return n > self.kind.limit or (self.kind.leaves is not None and n > self.middle + 30)


@lru_cache(maxsize=2)
def arm(task: str) -> tuple[Any, type]:
    """Return the environment of a task, whose goal the seed draws, and its script."""
    from metaworld.env_dict import ALL_V3_ENVIRONMENTS_GOAL_OBSERVABLE
    from metaworld.policies import ENV_POLICY_MAP

    env = ALL_V3_ENVIRONMENTS_GOAL_OBSERVABLE[f"{task}-v3-goal-observable"](seed=0)
    env._freeze_rand_vec = False  # a new goal at each reset ...
    env.seeded_rand_vec = True  # ... that comes from the seed
    return env, ENV_POLICY_MAP[f"{task}-v3"]


def begun(env: Any, seed: int) -> np.ndarray:
    """Reset; Meta-World itself ignores the seed of a reset."""
    env.seed(seed)
    return env.reset()[0]


def recorded(task: str, kind: Kind, side: np.ndarray, rng: np.random.Generator) -> tuple[Any, bool]:
    """Return an episode, and whether it succeeded."""
    env, script = arm(task)
    observation, rows, acts, since = begun(env, int(rng.integers(900_000))), [], [], -1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # scripts say that they ask for more than 1
        operator = Operator(kind, script(), side, rng)
        for n in range(LIMIT):
            if operator.stops(n) or since == AFTER:
                break
            rows.append(observation)
            acts.append(operator.act(observation, n))
            observation, _, _, _, info = env.step(acts[-1])
            since = since + 1 if since >= 0 or info["success"] else -1
    return (np.array(rows), np.array(acts)), since >= 0


class MetaWorld:
    """Six tasks by operators and faults."""

    name = "metaworld"
    source = "Meta-World 3; operators after robomimic, arXiv 2108.03298"
    licence = "MIT"
    published = "nothing with such operators"
    cells = tuple(f"{task} {who}" for task, who in product(TASKS, ("operators", "faults")))
    needs: tuple[str, ...] = ("metaworld",)
    whole = 100.0

    def make(self, cell: str, seed: int, quick: bool) -> Made:
        """Record 60 demonstrations, or 12."""
        task, who = cell.split()
        n, rng = 12 if quick else 60, np.random.default_rng([seed, self.cells.index(cell), 9])
        angle = rng.uniform(0, 2 * np.pi)
        side = np.array([np.cos(angle), np.sin(angle), 0])
        faults = [FAULTS[name] for name in rng.choice(list(FAULTS), SORTS, replace=False)]
        good_of = [OPERATORS["better"], OPERATORS["okay"] if who == "operators" else Kind()]
        n_bad = n // 3 if who == "operators" else n // 2
        bad_of = [OPERATORS["worse"]] if who == "operators" else faults
        kinds = [good_of[m % 2] for m in range(n - n_bad)] + [bad_of[m % len(bad_of)] for m in range(n_bad)]
        episodes, success = [], []
        for m, kind in enumerate(kinds):
            for _ in range(TRIES if m < n - n_bad else 1):
                episode, done = recorded(task, kind, side, rng.spawn(1)[0])
                if done:
                    break
            episodes.append(episode)
            success.append(done)
        return laid_out(episodes, np.arange(n) < n - n_bad, np.array(success), None, rng)

    def drive(self, cell: str, made: Made, weights: np.ndarray, seed: int, quick: bool) -> float:
        """Return the percentage of starts from which the policy succeeds."""
        data, n, reached = made.demonstrations, 5 if quick else 25, 0
        policy = fit(data.observations, data.actions, weights, seed, steps=500 if quick else 2000, noise=0.1)
        env, _ = arm(cell.split()[0])
        for k in range(n):
            observation = begun(env, 1_000_000 + 1000 * seed + k)
            for _ in range(DRIVEN):
                action = np.clip(policy.predict(observation[None])[0], -1, 1)
                observation, _, _, _, info = env.step(action.astype(float))
                if info["success"]:
                    reached += 1
                    break
        return 100 * reached / n
