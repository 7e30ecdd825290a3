"""Who ranks recorded demonstrations best without answers: other methods beside ours.

    python benchmarks/peers.py --data ../shared/data --json peers.json
    python benchmarks/peers.py --quick

AUROC of good against bad demonstrations on every recorded set that has both, and paired differences to ours. Methods
are in `contestants`. Without an answer nobody knows which side is good: below .5 a method has it upside down.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Callable
from functools import partial
from itertools import product
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np

from claims import auroc
from contestants import CONTESTANTS, OURS
from options import asked
from provenance import line, provenance
from rpil.data.errors import DataError
from tables import table
from worlds import World
from worlds.recorded import read, recorded_sets
from worlds.simulated import of_paper

Row = dict[str, Any]
QUICK = ("rpil", "likelihood", "length")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of NPZ files")
    parser.add_argument("--methods", nargs="+", choices=CONTESTANTS, default=list(CONTESTANTS), metavar="METHOD")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="OUT", help="also write every figure")
    parser.add_argument("--quick", action="store_true", help="one small world and three methods: checks the script")
    options = parser.parse_args(arguments)
    if not (options.data or options.quick):
        parser.error("say where the NPZ files are: --data DIR.")
    sets: dict[str, Callable[[], World]] = {"quick": partial(of_paper, "MountainCar-v0", "random", 0)}
    if not options.quick:
        sets = {path.stem: partial(read, path) for path in recorded_sets(options.data)}
    jobs = [(name, make, method) for (name, make), method in product(sets.items(), options.methods)]
    if options.quick:
        jobs = [job for job in jobs if job[2] in QUICK]
    with Pool(options.processes, maxtasksperchild=8) as pool:
        rows = pool.starmap(scored, jobs, chunksize=1)
    found = {"provenance": provenance(0, asked(parser, options)), "rows": rows}
    print(markdown(found))
    print(f"\n{line(found['provenance'])}")
    if options.json:
        options.json.write_text(json.dumps(found))
    return 0


def scored(name: str, make: Callable[[], World], method: str) -> Row:
    """AUROC of a method on a set, None where the method is not made for such actions."""
    world = make()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            value = auroc(world.is_good, CONTESTANTS[method](world.demonstrations, 0))
    except DataError:
        value = None
    return {"set": name, "method": method, "auroc": value}


def markdown(result: Row) -> str:
    """The section of docs/results.md."""
    sets, methods = (list(dict.fromkeys(row[key] for row in result["rows"])) for key in ("set", "method"))
    found: dict[str, dict[str, float]] = {method: {} for method in methods}
    for row in result["rows"]:
        if row["auroc"] is not None:
            found[row["method"]][row["set"]] = row["auroc"]
    ours = found.get(OURS, {})
    summary = [[method, *summarised(own, {} if method == OURS else ours)] for method, own in found.items()]
    each = [[name, *(f"{own[name]:.2f}" if name in own else "–" for own in found.values())] for name in sets]
    text = "AUROC of rankings without answers (benchmarks/peers.py); – where a method is not made for such actions."
    columns = ["method", "AUROC, mean", "sets", "less ours on the same sets", "sets below .5"]
    return "\n\n".join(["## Other methods", text, table(columns, summary), table(["set", *methods], each)])


def summarised(own: dict[str, float], ours: dict[str, float]) -> list[str]:
    """The mean, the number of sets, the mean difference to ours with its standard error, and sets below one half."""
    values = list(own.values())
    less = np.array([own[name] - ours[name] for name in own if name in ours])
    difference = f"{less.mean():+.3f} ± {less.std(ddof=1) / np.sqrt(len(less)):.3f}" if len(less) > 1 else ""
    below = sum(value < 0.5 for value in values)
    return [f"{np.mean(values):.3f}" if values else "–", f"{len(values)}", difference, f"{below}"]


if __name__ == "__main__":
    sys.exit(main())
