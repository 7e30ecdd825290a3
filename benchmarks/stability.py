"""Does chance decide the finding? Small worlds, audited with other seeds and in other orders of the demonstrations.

    python benchmarks/stability.py
    python benchmarks/stability.py --quick

A world is alike if its finding is the same with `random_state` 0 to 5 and in four orders.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from multiprocessing import Pool

import numpy as np

import rpil
from options import asked
from provenance import line, provenance
from worlds.kinds import KINDS, small

SEEDS, ORDERS = 6, 4


def findings(k: int) -> tuple[list[str], list[str]]:
    """The findings of a small world by seed, and those by order."""
    demonstrations = small(k).demonstrations
    orders = [np.random.default_rng([25, n]).permutation(len(demonstrations)) for n in range(ORDERS)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        by_seed = [rpil.audit(demonstrations, random_state=seed).finding for seed in range(SEEDS)]
        by_order = [rpil.audit(demonstrations.select(order)).finding for order in orders]
    return by_seed, [by_seed[0], *by_order]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="two worlds: checks the script")
    options = parser.parse_args(arguments)
    worlds = [k for (k,) in KINDS["small"][1]][: 2 if options.quick else None]
    with Pool(options.processes) as pool:
        every = pool.map(findings, worlds, chunksize=1)
    for n, name in enumerate(("random_state", "order")):
        print(f"Alike with another {name}: {sum(len(set(found[n])) == 1 for found in every)} of {len(every)} worlds.")
    for k, found in zip(worlds, every, strict=True):
        if len(set(found[0] + found[1])) > 1:
            print(f"- world {k}: {dict(Counter(found[0]))} by seed, {dict(Counter(found[1]))} by order")
    print(f"\n{line(provenance(f'0 to {SEEDS - 1}', asked(parser, options)))}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
