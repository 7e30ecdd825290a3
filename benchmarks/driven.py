"""What the learner's policy achieves where it is driven: `RPIL()`, all demonstrations alike, and the good ones alone.

    python benchmarks/driven.py --processes 2 --json driven.json      # a quarter of an hour of one core
    python benchmarks/driven.py --quick

Worlds are the games and the disc of `value.worlds`, where a network learns from the steps that have a weight, and the
points of `worlds.driven`, where `RPIL` and `BehavioralCloning` learn as they are. A cell is a kind of world and a share
of bad demonstrations, over seeds; success in %. The part of the gain is the sum of what `RPIL()` gains over all alike
in the cells where the good ones alone gain more than five points, over the sum of what these gain.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable
from functools import partial
from itertools import product
from multiprocessing import Pool
from typing import Any

import numpy as np
from sklearn.neural_network import MLPClassifier, MLPRegressor
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from options import asked, at_least, output, write_json
from provenance import line, provenance
from rpil import RPIL, BehavioralCloning
from rpil.data.demonstrations import Demonstrations
from tables import table
from value.worlds import drive, make_world
from worlds import Array, driven

Row = dict[str, Any]
GAMES = ("CartPole-v1", "MountainCar-v0", "Acrobot-v1", "Pendulum-v1")
DISCS = ("disc careless", "disc timid", "disc stuck", "disc two operators", "disc four operators")
SHARES, SEEDS, WORTH = (0.2, 0.4), 10, 5.0
"""Shares of bad ones, data sets of a cell, and points that the good ones alone gain where a part is counted."""
UPDATES, BATCH = 800, 256
"""Of the network, which reaches 95 to 99 % from careful drivers of the disc, in a second."""
LEARNER, ALL, ORACLE = "RPIL()", "all alike", "good alone"


def of_value(task: str, n: int, n_episodes: int, share: float, seed: int) -> Row:
    """A world of `value.worlds`: a network learns from each choice of steps."""
    world = make_world(task, n, share, seed)
    data = world.demonstrations
    chosen = {
        LEARNER: RPIL().fit(data).audit_.step_weight > 0,
        ALL: np.ones(data.n_steps, dtype=bool),
        ORACLE: np.repeat(world.is_good, data.lengths),
    }
    found: dict[bytes, float] = {}  # equal steps, equal policies
    for steps in chosen.values():
        if steps.tobytes() not in found:
            policy = network(data, steps, seed)
            found[steps.tobytes()] = float(drive(task, policy, n_episodes, seed)[0].mean())
    return {name: 100 * found[steps.tobytes()] for name, steps in chosen.items()}


def network(data: Demonstrations, steps: Array, seed: int) -> Pipeline:
    """Two hidden layers, fitted to these steps."""
    kind = MLPClassifier if data.is_discrete else MLPRegressor
    rounds = max(round(UPDATES * BATCH / steps.sum()), 1)
    layers = kind(
        hidden_layer_sizes=(48, 48),
        learning_rate_init=0.01,
        batch_size=min(BATCH, int(steps.sum())),
        max_iter=rounds,
        n_iter_no_change=rounds + 1,
        alpha=1e-3,
        random_state=seed,
    )
    return make_pipeline(StandardScaler(), layers).fit(data.observations[steps], data.actions[steps])


def of_points(kind: str, discrete: bool, n: int, share: float, seed: int) -> Row:
    """A world of `worlds.driven`, and the library's policies."""
    world = driven.demonstrations(kind, discrete, n, share, seed)
    data = world.demonstrations
    policies = {
        LEARNER: RPIL().fit(data),
        ALL: BehavioralCloning().fit(data),
        ORACLE: BehavioralCloning().fit(world.good_half().demonstrations),
    }
    return {name: 100 * driven.drive(kind, policy, 100, seed) for name, policy in policies.items()}


def cells() -> dict[str, Callable[[float, int], Row]]:
    """What is driven, by the name of its world: a share and a seed to the success of each policy, in %."""
    found: dict[str, Callable[[float, int], Row]] = {}
    for kind, discrete in product(driven.KINDS, (False, True)):
        found[f"{kind}, {'directions' if discrete else 'forces'}"] = partial(of_points, kind, discrete, 40)
    return found | {
        **{task: partial(of_value, task, 40, 20) for task in GAMES},
        **{task: partial(of_value, task, 100, 200) for task in DISCS},
    }


def measure(job: tuple[str, float, int]) -> Row:
    """One data set."""
    name, share, seed = job
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {"world": name, "share": share, "seed": seed, **cells()[name](share, seed)}


def report(rows: list[Row]) -> list[str]:
    """A line for each cell, the part of the oracle's gain, and the worst cell."""
    lines, gains = [], []
    for name, share in dict.fromkeys((row["world"], row["share"]) for row in rows):
        own = [row for row in rows if (row["world"], row["share"]) == (name, share)]
        ours, plain, oracle = (float(np.mean([row[who] for row in own])) for who in (LEARNER, ALL, ORACLE))
        gains.append((ours - plain, oracle - plain, f"{name}, {share:.0%}"))
        lines.append([name, f"{share:.0%}", f"{plain:.1f}", f"{ours - plain:+.1f}", f"{oracle - plain:+.1f}"])
    worth = [gain for gain in gains if gain[1] > WORTH]
    part = sum(gain[0] for gain in worth) / sum(gain[1] for gain in worth) if worth else float("nan")
    worst = min(gains)
    header = ["world", "bad", ALL, LEARNER, ORACLE]
    return [
        table(header, lines, text_columns=2),
        "",
        f"{len(worth)} of {len(gains)} cells in which the good ones alone gain more than {WORTH:.0f} points: `RPIL()` "
        f"gains {part:.2f} of that. Worst cell: {worst[2]}, {worst[0]:+.1f}; {sum(gain[0] < -WORTH for gain in gains)} "
        f"below {-WORTH:+.0f}.",
    ]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="TEXT", default="", help="only worlds whose names hold this text")
    parser.add_argument("--seeds", type=at_least(1), default=SEEDS)
    parser.add_argument("--processes", type=at_least(1), default=1)
    parser.add_argument("--json", type=output, metavar="OUT", help="also write every row")
    parser.add_argument("--quick", action="store_true", help="two cells: checks the script")
    options = parser.parse_args(arguments)
    names = [name for name in cells() if options.only in name]
    jobs = list(product(names, SHARES, range(options.seeds)))
    if options.quick:
        jobs = [("hidden goal, forces", 0.4, 0), ("MountainCar-v0", 0.4, 0)]
    with Pool(options.processes) as pool:
        rows = pool.map(measure, jobs, chunksize=1)
    origin = provenance(f"0 to {options.seeds - 1}", asked(parser, options))
    print("\n".join([*report(rows), "", line(origin)]))
    if options.json:
        write_json(options.json, {"provenance": origin, "rows": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
