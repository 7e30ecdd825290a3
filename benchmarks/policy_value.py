"""Does choosing demonstrations with rpil make better policies? Policies are trained by rules and driven.

    python benchmarks/policy_value.py --out value.jsonl
    python benchmarks/policy_value.py --out value.jsonl --report
    python benchmarks/policy_value.py --quick

Needs ``pip install 'rpil[value]'``. A cell is a task, a number of demonstrations, a share of bad ones, a learner, a
rule and a seed. Each finished cell is a line of the file, and what is in the file is not done again. All rules are
driven from the same starts; rules with the same weights have the same policy, which is trained once.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from rpil.numerics.types import Array
from value.learners import CHUNKS, LEARNERS, TRAINING, Learner
from value.report import Row, report
from value.rules import RULES, Judged, weights_of
from value.worlds import GAMES, TASKS, World, drive, make_world

QUICK = {"tasks": ["MountainCar-v0"], "n": [8], "shares": [0.5], "seeds": [0], "episodes": 3, "steps": 50}
QUICK_RULES = ["all", "keep", "oracle"]
KEY = ("task", "n", "share", "seed", "learner", "rule", "episodes", "steps")
"""What makes a cell."""


@dataclass(frozen=True)
class Data:
    """One data set and what is to be done with it."""

    task: str
    n: int
    share: float
    seed: int
    learners: tuple[str, ...]
    rules: tuple[str, ...]
    episodes: int
    steps: int
    """Of training a network."""
    out: Path
    done: frozenset[tuple[Any, ...]]

    def cell(self, learner: str, rule: str) -> Row:
        values = self.task, self.n, self.share, self.seed, learner, rule, self.episodes, self.steps
        return dict(zip(KEY, values, strict=True))

    def left(self) -> list[Row]:
        """The cells that are not done."""
        pairs = product(self.learners, self.rules)
        cells = [self.cell(*pair) for pair in pairs if not (pair[0] == "chunks" and self.task in GAMES)]
        return [cell for cell in cells if tuple(cell.values()) not in self.done]


def main(arguments: list[str] | None = None) -> int:
    options = parse(arguments)
    if options.quick:
        with tempfile.TemporaryDirectory() as folder:
            options.out = options.out or Path(folder) / "value.jsonl"
            return run(options)
    return run(options)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, metavar="FILE", help="JSON lines, to which finished cells are added")
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS), metavar="TASK")
    parser.add_argument("--n", nargs="+", type=int, default=[20, 50], help="numbers of demonstrations")
    parser.add_argument("--shares", nargs="+", type=float, default=[0.0, 0.1, 0.3, 0.5], help="of bad ones")
    parser.add_argument("--learners", nargs="+", choices=LEARNERS, default=["network", "linear"], metavar="LEARNER")
    parser.add_argument("--rules", nargs="+", choices=RULES, default=list(RULES), metavar="RULE")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--episodes", type=int, default=25, help="driven for each policy")
    parser.add_argument("--steps", type=int, default=TRAINING.steps, help="of training a network")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--report", action="store_true", help="only print the tables of what is done")
    parser.add_argument("--quick", action="store_true", help="one small world: checks the script")
    options = parser.parse_args(arguments)
    if not (options.out or options.quick):
        parser.error("say where finished cells are kept: --out FILE.")
    if options.quick:
        vars(options).update(QUICK, rules=QUICK_RULES)
    return options


def run(options: argparse.Namespace) -> int:
    """Do what is left, and print the tables."""
    if not options.report:
        done = frozenset(tuple(row[name] for name in KEY) for row in read(options.out))
        shared = tuple(options.learners), tuple(options.rules), options.episodes, options.steps, options.out, done
        jobs = product(options.seeds, options.n, options.shares, options.tasks)
        sets = [Data(task, n, share, seed, *shared) for seed, n, share, task in jobs]
        sets = [data for data in sets if data.left()]
        if options.processes > 1:
            with get_context("spawn").Pool(options.processes, maxtasksperchild=8) as pool:
                pool.map(finish, sets, chunksize=1)
        else:
            for data in sets:
                finish(data)
    print(report(chosen(read(options.out), options)))
    return 0


def read(path: Path) -> list[Row]:
    """The finished cells; a line that an interruption cut off is left out."""
    rows = []
    for text in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            rows.append(json.loads(text))
        except ValueError:
            continue
    return rows


def chosen(rows: Iterable[Row], options: argparse.Namespace) -> list[Row]:
    """The cells that were asked for."""
    asked = {"task": options.tasks, "n": options.n, "share": options.shares, "seed": options.seeds}
    asked |= {"learner": options.learners, "rule": options.rules}
    asked |= {"episodes": [options.episodes], "steps": [options.steps]}
    return [row for row in rows if all(row[name] in values for name, values in asked.items())]


def finish(data: Data) -> None:
    """Do the cells that are left of one data set; each is written when it is done."""
    world = make_world(data.task, data.n, data.share, data.seed)
    judged = Judged(world.demonstrations)
    driven: dict[tuple[str, bytes], Row] = {}
    for cell in data.left():
        started = time.perf_counter()
        weight = weights_of(RULES[cell["rule"]], world, judged, data.seed)
        policy = cell["learner"], weight.tobytes()
        if policy not in driven:
            driven[policy] = value_of(data, world, cell["learner"], weight)
        seconds = round(time.perf_counter() - started, 2)
        row = cell | driven[policy] | describe(world, judged, weight) | {"seconds": seconds}
        with data.out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def value_of(data: Data, world: World, name: str, weight: Array) -> Row:
    """Train with these weights and drive."""
    policy = learner_of(name, data.steps)(world.demonstrations, weight, data.seed)
    found = drive(data.task, policy, data.episodes, data.seed)
    steps = round(found.mean_steps, 1) if np.isfinite(found.mean_steps) else None
    return {"success": float(found.success.mean()), "mean_steps": steps}


def learner_of(name: str, steps: int) -> Learner:
    if name == "linear":
        return LEARNERS[name]
    return partial(LEARNERS[name], training=replace(CHUNKS if name == "chunks" else TRAINING, steps=steps))


def describe(world: World, judged: Judged, weight: Array) -> Row:
    """What was kept. The truth is read here to score, after the rule."""
    good = np.repeat(world.is_good, world.demonstrations.lengths)
    of_bad = sorted({kind for kind, is_good in zip(world.kinds, world.is_good, strict=True) if not is_good})
    return {
        "kept": round(float(weight.mean()), 4),
        "weight_on_good": round(float(weight @ good / weight.sum()), 4),
        "succeeded": round(float(world.success.mean()), 4),
        "kinds": of_bad,
        "finding": judged.audit.finding,
    }


if __name__ == "__main__":
    sys.exit(main())
