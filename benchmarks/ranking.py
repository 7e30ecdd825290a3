"""How demonstrations are ranked without answers: the AUROC of each set, the mean rank of each kind, from 0 to 1.

Also how many good ones are called outliers.

    python benchmarks/ranking.py --data ../shared/data --worlds worlds --json ranking.json
    python benchmarks/ranking.py --quick

Families: `arm`, sixteen tasks of Meta-World with half and a tenth of the demonstrations bad, and `given up`, where most
of the bad ones hold still to the time limit; a `gripper` that never closes; a `pendulum` with weak noisy torque; a
`point mass`; and `recorded` sets (--data). `--worlds DIR` keeps what was recorded on the arm.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from scipy.stats import rankdata

import value.worlds as arm
from rpil import RPIL
from value import stored
from worlds import Array
from worlds import point_mass as mass
from worlds.recorded import read, recorded_sets
from worlds.still import OPEN, STILL, Set, on_the_arm, pendulum

KINDS = (STILL, "late", "pauses", "shaky", "detours")
ARM = {"arm 50 %": (20, KINDS, 5), "arm 10 %": (4, KINDS, 6), "given up": (10, (STILL, STILL, "late"), 7)}
"""Bad ones of 40, their kinds, and the seed."""
GRASPS = ("pick-place", "peg-insert-side", "push", "hammer")


def from_arm(folder: Path, family: str, task: str, given: tuple[int, tuple[str, ...], int]) -> Set:
    path = folder / f"{family.replace(' ', '-').replace('%', 'percent')}_{task}.npz"
    if not path.exists():
        stored.write(path, on_the_arm(task, *given))
    world = stored.read(path)
    return world.demonstrations, world.is_good, world.kinds


def point(kind: str, discrete: bool) -> Set:
    world = mass.point_mass(kind, discrete, (40, 12), 1)
    return world.demonstrations, world.is_good, tuple("good" if good else kind for good in world.is_good)


def recorded(path: Path) -> Set:
    world = read(path)
    return world.demonstrations, world.is_good, tuple(map(str, world.is_good))


def sets(options: argparse.Namespace) -> Iterator[tuple[str, str, Callable[[], Set]]]:
    """Family, name, and what makes the set."""
    for seed in range(1 if options.quick else 20):
        yield "pendulum", str(seed), partial(pendulum, seed)
    for kind, discrete in product(("stuck",) if options.quick else mass.BAD, (False, True)):
        yield "point mass", f"{kind}, {'discrete' if discrete else 'continuous'}", partial(point, kind, discrete)
    for path in recorded_sets(options.data) if options.data else ():
        yield "recorded", path.stem, partial(recorded, path)
    if options.worlds and not options.quick:
        for family, given in ARM.items():
            for task in (*arm.ARM_TASKS, *arm.OTHER_ARM_TASKS):
                yield family, task, partial(from_arm, options.worlds, family, task, given)
        for seed, task in product(range(3, 8), GRASPS):
            name = f"gripper {seed}" if seed > 3 else "gripper"
            yield "gripper", f"{task} {seed}", partial(from_arm, options.worlds, name, task, (6, (OPEN,), seed))


def auroc(log_odds: Array, is_good: Array) -> float:
    """Probability that a good one ranks above a bad one; ties count one half."""
    above = np.sign(log_odds[is_good == 1][:, None] - log_odds[is_good == 0])
    return float((above + 1).mean() / 2)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of NPZ files of recorded demonstrations")
    parser.add_argument("--worlds", type=Path, metavar="DIR", help="where demonstrations of the arm are, or are kept")
    parser.add_argument("--json", type=Path, metavar="OUT", help="also write the AUROC of each set")
    parser.add_argument("--quick", action="store_true", help="three small sets: checks the script")
    options = parser.parse_args(arguments)
    found, ranks = defaultdict[str, dict[str, float]](dict), defaultdict[str, dict[str, list[float]]](dict)
    accused: dict[str, Array] = {}
    for family, name, make in sets(options):
        demonstrations, is_good, kinds = make()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that groups are ambiguous
            audit = RPIL().fit(demonstrations).audit_
        log_odds, outlier = audit.log_odds, np.array(audit.verdicts) == "outlier"
        counts = np.array([(outlier & (is_good == 1)).sum(), (is_good == 1).sum()])
        accused[family] = accused.get(family, 0) + counts
        found[family][name] = auroc(log_odds, is_good)
        for kind, rank in zip(kinds, (rankdata(log_odds) - 1) / (len(kinds) - 1), strict=True):
            ranks[family].setdefault(kind, []).append(float(rank))
    for family, of_sets in found.items():
        worst = min(of_sets, key=of_sets.__getitem__)
        said = "; ".join(f"{kind} {np.mean(every):.2f}" for kind, every in ranks[family].items())
        print(
            f"{family}: {np.mean(list(of_sets.values())):.3f} (worst {worst}, {of_sets[worst]:.2f}); ranks: {said}; "
            f"good ones called outliers: {accused[family][0]} of {accused[family][1]}"
        )
    if options.json:
        options.json.write_text(json.dumps(found, indent=1))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
