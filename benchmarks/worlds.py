"""Worlds of a point mass, to break the words of an audit: kinds of operators that no constant was chosen on.

    python benchmarks/worlds.py --json worlds.json
    python benchmarks/worlds.py --only sessions,styles --seeds 5
    python benchmarks/worlds.py --quick

A mass in a plane goes to a goal, past an obstacle. In worlds of `BAD` operators some demonstrations are bad; in worlds
of `GOOD` operators all are good, though not alike, and nobody should be called unlike the others. Actions are forces,
or one of five directions. The truth scores, and no audit reads it.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from multiprocessing import Pool
from pathlib import Path

import numpy as np

from claims import Array, Job, Row, audited, auroc, counted
from provenance import line, provenance
from rpil.data.demonstrations import Demonstrations

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


def world(kind: str, discrete: bool, size: tuple[int, int], seed: int) -> tuple[Demonstrations, Array]:
    """Demonstrations in random order, and 1 good, 0 bad for each."""
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
    return Demonstrations.from_episodes(episodes), np.array(
        [int(kind not in BAD or m < total - others) for m in places]
    )


def jobs(kinds: list[str], seeds: int) -> list[Job]:
    """Every audit."""
    grid = product(kinds, (False, True), SIZES, range(seeds))
    return [
        Job(
            kind,
            f"{kind}, {'discrete' if d else 'continuous'}, {n} of {m}, {seed}",
            partial(world, kind, d, (m, n), seed),
        )
        for kind, d, (m, n), seed in grid
    ]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    every = [*BAD, *GOOD, *ALL_DIFFER]
    parser.add_argument("--only", default=",".join(every), metavar="KINDS", help=f"of {', '.join(every)}")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="OUT", help="also write every row")
    parser.add_argument("--quick", action="store_true", help="one small world: checks the script")
    options = parser.parse_args(arguments)
    every = jobs(options.only.split(","), options.seeds)
    with Pool(options.processes, maxtasksperchild=20) as pool:
        rows = list(pool.imap(audited, every[:1] if options.quick else every))
    print("\n".join(report(rows)))
    if options.json:
        options.json.write_text(json.dumps({"provenance": provenance(options.seeds), "rows": rows}))
    print(f"\n{line(provenance(options.seeds))}")
    return 0


def markdown(result: Row) -> str:
    """The section of docs/results.md."""
    explained = (
        "Made worlds of a point mass, on which no constant was chosen; `hard` is a bang-bang operator among others."
    )
    return "\n".join(["## Worlds of a point mass", "", explained, "", *report(result["rows"])])


def report(rows: list[Row]) -> list[str]:
    """Tables in Markdown."""
    columns = (
        "| kind | worlds | unlike: bad, good | typical: good, bad | sets with a good one unlike | share with a word |"
    )
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    bad, good = ([row for row in rows if (row["kind"] in BAD) == is_bad] for is_bad in (True, False))
    lines = [columns, "|---|---|---|---|---|---|"]
    for kind in kinds:
        lines += counted(kind, [row for row in rows if row["kind"] == kind])
    lines += [*counted("all with bad ones", bad), *counted("nobody bad", good)]
    return [*lines, "", *described(rows)]


def described(rows: list[Row]) -> list[str]:
    """A line for each world with a good one called unlike."""
    return [
        f"- {row['name']}: {row['finding']}, AUROC {auroc(good, np.array(row['log_odds'])):.2f}, "
        f"{int(((words < 0) & (good == 1)).sum())} good and {int(((words < 0) & (good == 0)).sum())} bad ones unlike"
        for row in rows
        for good, words in [(np.array(row["good"]), np.array(row["words"]))]
        if ((words < 0) & (good == 1)).any()
    ]


if __name__ == "__main__":
    sys.exit(main())
