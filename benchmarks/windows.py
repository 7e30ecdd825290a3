"""How well does the audit find the bad steps of demonstrations that are otherwise good?

    python benchmarks/windows.py
    python benchmarks/windows.py --drive
    python benchmarks/windows.py --quick

Half of the demonstrations of a world have one window of bad steps, which are known: a robot arm pauses, goes astray,
is late, drops and recovers, or is shaky for a third of an episode; a game's expert acts at random for half of it. The
first table is of single steps: AUROC of good against bad, in all demonstrations and in those with a window, and the
weight of a bad step, in weights of a good one; P(step) is also made with other constants ("stay .8"). With ``--drive``
policies are trained by rules and driven. Needs ``pip install 'rpil[value]'``. Figures are means and standard errors
over seeds.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections import defaultdict
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.metrics import roc_auc_score

import more_experts  # noqa: F401 (makes these known)
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.inference.settings import StepSettings
from rpil.inference.step_trust import step_proba
from rpil.numerics.types import Array
from rpil.simulation.experts import expert
from rpil.simulation.rollouts import actions_of, make, record
from rpil.simulation.simulate import window
from tables import table
from value.learners import LEARNERS
from value.operators import GOOD, INTERLUDES, TYPICAL, Kind, Operator
from value.rules import Judged, best
from value.worlds import GENTLE, Episode, drive, record_arm

LENGTH = TYPICAL // 3
"""Steps of the window of an arm."""
WINDOWS = {
    "pause": Kind(gain=0.0),
    "detour": Kind(strays=LENGTH),
    "late": Kind(delay=6),
    "drop": Kind(leaves=(0.5, -1)),
    "shaky": Kind(tremor=0.8),
}
ARM_TASKS = ("reach", "button-press-topdown", "drawer-open", "push", "pick-place")
GAME_TASKS = ("LunarLander-v3", "LunarLanderContinuous-v3", "MountainCar-v0", "Acrobot-v1", "Pendulum-v1")
RANDOM = "random"
OTHERS = {
    "stay .8": StepSettings(stay=0.8),
    "stay .99": StepSettings(stay=0.99),
    "alone": StepSettings(p_stretches=1e-9),
}
"""What the constants of P(step) are worth."""
WORLDS = [(task, kind) for task in ARM_TASKS for kind in WINDOWS] + [(task, RANDOM) for task in GAME_TASKS]
TRIES = 20
"""An operator who fails, or is done before the window, begins again, at most so many times."""


class Interrupted(Operator):
    """A good operator who is of another kind in a window, or has none."""

    def __init__(self, inside: Kind | None, rng: np.random.Generator) -> None:
        self.outside = GOOD["gentle" if rng.random() < GENTLE else "normal"]
        super().__init__(self.outside, None, np.zeros(3), rng)
        self.inside = inside or self.outside
        self.first = self.middle = int(TYPICAL * rng.uniform(0.1, 0.6))
        self.interludes = np.full(INTERLUDES, self.first)

    def employed(self, script: Any) -> Interrupted:
        """Drives by the script."""
        self.script = script
        return self

    def act(self, observation: Array, n: int) -> Array:
        self.kind = self.inside if self.first <= n < self.first + LENGTH else self.outside
        return super().act(observation, n)

    def is_bad(self, n_steps: int) -> Array:
        """Of the first steps, (n_steps,) bool."""
        steps = np.arange(n_steps)
        return (steps >= self.first) & (steps < self.first + LENGTH) & (self.inside is not self.outside)


@dataclass(frozen=True, eq=False)
class World:
    demonstrations: Demonstrations
    is_bad: Array
    """Of each step, (N,) bool."""
    has_window: Array
    """Of each demonstration, (M,) bool."""


def make_world(task: str, kind: str, n: int, seed: int) -> World:
    """`n` demonstrations in random order, half of them with a window."""
    rng = np.random.default_rng([seed, zlib.crc32(f"{task} {kind}".encode())])
    has_window = rng.permutation(n) < n // 2
    make = _game if kind == RANDOM else _arm
    episodes, is_bad = make(task, kind, has_window, rng)
    return World(Demonstrations.from_episodes(episodes), np.concatenate(is_bad), has_window)


def _arm(task: str, kind: str, has_window: Array, rng: np.random.Generator) -> tuple[list[Episode], list[Array]]:
    episodes, is_bad = [], []
    for interrupted in has_window.tolist():
        for _ in range(TRIES):
            operator = Interrupted(WINDOWS[kind] if interrupted else None, rng.spawn(1)[0])
            episode, succeeded = record_arm(task, operator.employed, int(rng.integers(900_000)))
            found = operator.is_bad(len(episode[1]))
            if succeeded and found.any() == interrupted:
                break
        else:
            what = f"with a window of kind {kind}" if interrupted else "without a window"
            raise DataError(f"{task}: no success {what} in {TRIES} episodes; choose another task, kind or seed.")
        episodes.append(episode)
        is_bad.append(found)
    return episodes, is_bad


def _game(task: str, _: str, has_window: Array, rng: np.random.Generator) -> tuple[list[Episode], list[Array]]:
    driver, seed = expert(task), int(rng.integers(2**31))
    with closing(make(task)) as env:
        space = actions_of(env)
    episodes, is_bad = [], []
    for played, interrupted in zip(
        record(driver, task, n_episodes=len(has_window), seed=seed), has_window, strict=True
    ):
        observations, actions = played.observations, played.actions
        if interrupted:
            observations, actions = window(observations, actions, space, rng)
        changed = np.flatnonzero((actions != played.actions).reshape(len(actions), -1).any(axis=1))
        steps = np.arange(len(actions))
        is_bad.append((steps >= changed[0]) & (steps <= changed[-1]) if len(changed) else steps < 0)
        episodes.append((observations, actions))
    return episodes, is_bad


# ---- single steps ----------------------------------------------------------------------------------------------------


def scores_of(judged: Judged) -> dict[str, Array]:
    """What the audit says of each step, (N,); larger is better."""
    audit = judged.audit
    bound = audit.settings.judge.max_log_ratio
    bounded = np.clip(audit.step_log_ratio, -bound, bound)
    of_trust = audit.reliability, bounded, judged.lengths
    proba = {name: step_proba(*of_trust, settings) for name, settings in ({"P(step)": StepSettings()} | OTHERS).items()}
    return {"log-ratio": audit.step_log_ratio} | proba | {"weight": judged.learned.step_weight}


def of_steps(world: World, judged: Judged) -> dict[str, float]:
    good, some = ~world.is_bad, judged.per_step(world.has_window) > 0
    found = {}
    for name, score in scores_of(judged).items():
        if name not in OTHERS:
            found[f"{name}, all"] = float(roc_auc_score(good, score))
        found[f"{name}, windowed"] = float(roc_auc_score(good[some], score[some]))
    weight = judged.learned.step_weight
    found["bad weight"] = float(weight[world.is_bad].mean() / max(weight[good].mean(), 1e-12))
    return found


# ---- policies --------------------------------------------------------------------------------------------------------

RULES: dict[str, Callable[[World, Judged], Array]] = {
    "all": lambda world, judged: np.ones(len(world.is_bad)),
    "steps": lambda world, judged: judged.learned.step_weight,
    "demonstrations": lambda world, judged: judged.per_step(judged.audit.expert_proba),
    "best 60 %": lambda world, judged: judged.per_step(best(judged.audit.log_odds, 0.6)),
    "truth": lambda world, judged: 1.0 - world.is_bad,
}


def driven(task: str, world: World, judged: Judged, seed: int, episodes: int) -> dict[str, float]:
    """Success of a network that is trained by each rule."""
    found = {}
    for name, rule in RULES.items():
        policy = LEARNERS["network"](world.demonstrations, rule(world, judged), seed)
        found[name] = float(drive(task, policy, episodes, seed)[0].mean())
    return found


# ---- tables ----------------------------------------------------------------------------------------------------------


def report(rows: list[tuple[str, dict[str, float]]]) -> str:
    """A row for each world and their mean; (name of a world, figures) are averaged over seeds."""
    of_world = defaultdict(list)
    for name, row in rows:
        of_world[name].append(list(row.values()))
    cells = [[name, *figures(np.array(values))] for name, values in of_world.items()]
    means = np.array([np.mean(values, axis=0) for values in of_world.values()])
    return table(["", *rows[0][1]], [*cells, ["mean of worlds", *figures(means)]])


def figures(values: Array) -> list[str]:
    """Means and standard errors of the columns of `values` (S, C)."""
    n = len(values)
    error = values.std(axis=0, ddof=1) / np.sqrt(n) if n > 1 else np.full(values.shape[1], np.nan)
    return [f"{mean:.2f} ± {each:.2f}" for mean, each in zip(values.mean(axis=0), error, strict=True)]


def main(arguments: list[str] | None = None) -> int:
    options = parse(arguments)
    rows = []
    for task, kind in options.worlds:
        for seed in options.seeds:
            world = make_world(task, kind, options.n, seed)
            judged = Judged(world.demonstrations)
            of = driven(task, world, judged, seed, options.episodes) if options.drive else of_steps(world, judged)
            rows.append((f"{task} {kind}", of))
    print(report(rows))
    return 0


def parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", choices=[*ARM_TASKS, *GAME_TASKS], metavar="TASK")
    parser.add_argument("--kinds", nargs="+", choices=[*WINDOWS, RANDOM], default=[*WINDOWS, RANDOM], metavar="KIND")
    parser.add_argument("--n", type=int, default=30, help="number of demonstrations")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--drive", action="store_true", help="train policies and drive them")
    parser.add_argument("--episodes", type=int, default=25, help="driven for each policy")
    parser.add_argument("--quick", action="store_true", help="one small world: checks the script")
    options = parser.parse_args(arguments)
    options.tasks = options.tasks or [*ARM_TASKS, *GAME_TASKS]
    if options.quick:
        options.tasks, options.seeds, options.n = ["MountainCar-v0"], [0], 8
    asked = [each for each in WORLDS if each[0] in options.tasks and each[1] in options.kinds]
    options.worlds = [each for each in asked if not (options.drive and each[0] == "Pendulum-v1")]
    if not options.worlds:
        parser.error("no world is left: arms have windows of their kinds, games random ones; Pendulum is not driven.")
    return options


if __name__ == "__main__":
    sys.exit(main())
