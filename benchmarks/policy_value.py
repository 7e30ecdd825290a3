"""Does choosing demonstrations with rpil make better policies? Policies are trained by rules and driven.

    python benchmarks/policy_value.py --out value.jsonl
    python benchmarks/policy_value.py --out value.jsonl more.jsonl --report
    python benchmarks/policy_value.py --preset disc --out disc.jsonl
    python benchmarks/policy_value.py --quick

Needs ``pip install 'rpil[value]'``. A cell is a data set (seed, number of demonstrations, share of bad ones, task), a
learner and a rule. Each finished cell is a line of the file, and is not done again; the report is of all in the files.
A preset fixes what is driven; what is given besides it replaces its values.
Rules are driven from the same starts; those that give the same weights share a policy.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import replace
from functools import cache, partial
from itertools import groupby, product
from multiprocessing import get_context
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from provenance import source
from rpil.numerics.types import Array
from value.learners import DISC_TRAINING, LEARNERS, TRAINING
from value.report import Row, picture, report
from value.rules import RULES, Judged, weights_of
from value.stored import recorded_world
from value.worlds import ARM_TASKS, DISC_TASKS, GAMES, OLDER_TASKS, OTHER_ARM_TASKS, TASKS, World, drive, family

LEADING_RULES = ["all", "step weights", "keep", "keep, 8 random labels", "oracle"]
PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "tasks": ["MountainCar-v0", "disc careless"],
        "n": [8],
        "shares": [0.5],
        "seeds": [0],
        "episodes": 3,
        "steps": 50,
        "rules": ["all", "keep", "oracle"],
    },
    "disc": {
        "tasks": list(DISC_TASKS),
        "n": [400],
        "shares": [0.0, 0.25, 0.5, 0.75, 0.9],
        "learners": ["network"],
        "seeds": list(range(20)),
        "episodes": 1000,
        "rules": LEADING_RULES,
    },
    "arm": {"tasks": list(ARM_TASKS), "n": [50], "shares": [0.5], "learners": ["network"], "rules": LEADING_RULES},
    "games": {"tasks": list(GAMES), "n": [50], "shares": [0.5], "learners": ["network"], "rules": LEADING_RULES},
    "other arm": {
        "tasks": list(OTHER_ARM_TASKS),
        "n": [40],
        "shares": [0.5],
        "learners": ["network", "drawn network"],
        "rules": [*LEADING_RULES, "best 60 %", "shortest 60 %", "successes", "8 random labels"],
    },
}
TRAININGS = {"disc": DISC_TRAINING}
"""Of a network, for a family of worlds that has its own."""
DATA = ("seed", "n", "share", "task")
"""What makes a data set."""
KEY = (*DATA, "learner", "rule", "episodes", "steps")
"""What makes a cell."""


def main(arguments: list[str] | None = None) -> int:
    options = parse(arguments)
    with tempfile.TemporaryDirectory() as folder:
        out = options.out or [Path(folder) / "value.jsonl"]
        if not options.report:
            run(left(options, read(*out)), out[0], options.processes, options.worlds)
        rows = read(*out)
        print(report(rows))
        if options.picture:
            picture(rows, options.picture)
    return 0


def parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--out", nargs="+", type=Path, metavar="FILE", help="JSON lines, to which finished cells are added"
    )
    parser.add_argument("--preset", choices=PRESETS, help="of the values below")
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(OLDER_TASKS), metavar="TASK")
    parser.add_argument("--n", nargs="+", type=int, default=[20, 50], help="numbers of demonstrations")
    parser.add_argument("--shares", nargs="+", type=float, default=[0.0, 0.1, 0.3, 0.5], help="of bad ones")
    parser.add_argument("--learners", nargs="+", choices=LEARNERS, default=["linear", "network"], metavar="LEARNER")
    parser.add_argument("--rules", nargs="+", choices=RULES, default=list(RULES), metavar="RULE")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--episodes", type=int, default=25, help="driven for each policy")
    parser.add_argument("--steps", type=int, help="of training a network, instead of those of its worlds")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--worlds", type=Path, metavar="DIR", help="where recorded worlds are kept as NPZ, and read")
    parser.add_argument("--report", action="store_true", help="only print the tables of what is done")
    parser.add_argument("--picture", type=Path, metavar="PNG", help="also draw success against the share kept")
    parser.add_argument(
        "--quick", dest="preset", action="store_const", const="quick", help="small worlds: checks the script"
    )
    parser.set_defaults(**PRESETS.get(parser.parse_args(arguments).preset, {}))
    options = parser.parse_args(arguments)
    if not (options.out or options.preset == "quick"):
        parser.error("say where finished cells are kept: --out FILE.")
    if not options.report and len(options.out or ()) > 1:
        parser.error("cells are added to one file: give several with --report only.")
    return options


def steps_of(task: str) -> int:
    """Of training a network in this task's worlds."""
    return TRAININGS.get(family(task), TRAINING).steps


def left(options: argparse.Namespace, rows: list[Row]) -> list[list[Row]]:
    """The cells that are asked for and not among `rows`, data set by data set."""
    done = {tuple(row[name] for name in KEY) for row in rows}
    asked = options.seeds, options.n, options.shares, options.tasks, options.learners, options.rules
    cells = [dict(zip(KEY, cell, strict=True)) for cell in product(*asked, [options.episodes], [options.steps])]
    cells = [cell | {"steps": cell["steps"] or steps_of(cell["task"])} for cell in cells]
    cells = [cell for cell in cells if tuple(cell.values()) not in done]
    return [list(same) for _, same in groupby(cells, itemgetter(*DATA))]


def run(sets: list[list[Row]], out: Path, processes: int, worlds: Path | None = None) -> None:
    if out.exists() and out.read_bytes()[-1:] not in (b"", b"\n"):
        with out.open("a", encoding="utf-8") as file:  # an interruption cut the last line off: the next has its own
            file.write("\n")
    if processes < 2:
        for cells in sets:
            finish(out, worlds, cells)
        return
    with get_context("spawn").Pool(processes, maxtasksperchild=8) as pool:
        pool.map(partial(finish, out, worlds), sets, chunksize=1)


def read(*paths: Path) -> list[Row]:
    """The finished cells, each once; a line that an interruption cut off is left out."""
    rows: dict[tuple[Any, ...], Row] = {}
    for text in [text for path in paths if path.exists() for text in path.read_text(encoding="utf-8").splitlines()]:
        try:
            row = json.loads(text)
        except ValueError:
            continue
        rows.setdefault(tuple(row[name] for name in KEY), row)
    return list(rows.values())


@cache
def of_this_process() -> Row:
    """The commit that this process runs."""
    return source()


def finish(out: Path, worlds: Path | None, cells: list[Row]) -> None:
    """Do cells of one data set; each is written when it is done."""
    of_this_process()
    world = recorded_world(worlds, *(cells[0][name] for name in ("task", "n", "share", "seed")))
    judged = Judged(world.demonstrations)
    driven: dict[tuple[str, bytes], Row] = {}
    for cell in cells:
        started = time.perf_counter()
        weight = weights_of(RULES[cell["rule"]], world, judged, cell["seed"])
        policy = cell["learner"], weight.tobytes()
        if policy not in driven:
            driven[policy] = value_of(cell, world, weight)
        seconds = round(time.perf_counter() - started, 2)
        row = cell | driven[policy] | describe(world, judged, weight) | {"seconds": seconds} | of_this_process()
        with out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def value_of(cell: Row, world: World, weight: Array) -> Row:
    """Train with these weights and drive."""
    training = replace(TRAININGS.get(family(cell["task"]), TRAINING), steps=cell["steps"])
    policy = LEARNERS[cell["learner"]](world.demonstrations, weight, cell["seed"], training)
    success, mean_steps = drive(cell["task"], policy, cell["episodes"], cell["seed"])
    return {"success": float(success.mean()), "mean_steps": mean_steps}


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
