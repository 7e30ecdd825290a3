"""Does a policy get better without the acts that are named, where it is driven?

    python benchmarks/segments_driven.py

In the plane of `worlds.tidying`, with a family of acts planted in half of the demonstrations, a forest learns actions
from all rows, from the rows outside of named segments after two marked ones, from the demonstrations without the
longest half, and from the rows that are right by the truth. Success is the share of things that are in place.
"""

from __future__ import annotations

import argparse
import sys
from itertools import pairwise

import numpy as np
from sklearn.ensemble import ExtraTreesRegressor

from options import at_least
from provenance import line, provenance
from rpil.segments.find import find_segments
from segments import drawn_marks
from tables import table
from worlds import Array
from worlds.tidying import TARGETS, Plane, Tidied, tidied

FAMILIES = "wrong place", "undone", "retry", "takeover"
N, SHARE, STEPS, STARTS, NEAR = 60, 0.5, 150, 30, 0.06


def features(states: Array) -> Array:
    """States, and where things and targets lie from the hand."""
    hand, one, other = states[:, :2], states[:, 3:5], states[:, 5:7]
    ways = one - hand, other - hand, one - TARGETS[0], other - TARGETS[1], hand - TARGETS[0], hand - TARGETS[1]
    return np.column_stack([states, *ways])


def success(made: Tidied, rows: Array, seed: int) -> float:
    """The share of things in place after a policy of these rows was driven."""
    states, actions = made.demonstrations.observations[rows], made.demonstrations.actions[rows]
    policy = ExtraTreesRegressor(30, random_state=0).fit(features(states), actions)
    rngs = np.random.default_rng([52, seed]).spawn(STARTS)
    planes = [Plane(rng, 0.0, rng.uniform([0.1, 0.05], [0.55, 0.95], size=(2, 2))) for rng in rngs]
    for _ in range(STEPS):
        predicted = policy.predict(features(np.array([plane.state() for plane in planes])))
        for plane, action in zip(planes, predicted, strict=True):
            plane.step(action[:2], float(action[2] > 0.5), (False, False, False))
    away = np.linalg.norm(np.array([plane.things for plane in planes]) - TARGETS, axis=2)
    return float((away < NEAR).mean())


def cell(family: str, seed: int) -> list[float]:
    """Success with all rows, those outside of named segments, those of the shorter half, and the right ones."""
    made = tidied(family, N, seed, share=SHARE, in_order=True)
    data, takeover = made.demonstrations, made.takeover if made.takeover.any() else None
    plain = find_segments(data, takeover=takeover)
    first = data.offsets[plain.demonstration] + plain.start
    share = np.array([made.bad[a:b].mean() for a, b in pairwise([*first, data.n_steps])])
    labels, _ = drawn_marks(plain, share, np.random.default_rng(seed))
    found = find_segments(data, takeover=takeover, labels=labels)
    marked = [(m, start) for m, start, _, good in labels if not good]
    dropped = [
        reason != "" or (m, start) in marked
        for reason, m, start in zip(found.reason, found.demonstration.tolist(), found.start.tolist(), strict=True)
    ]
    kept = ~np.repeat(dropped, found.end - found.start)
    short = np.repeat(data.lengths <= np.median(data.lengths), data.lengths)
    return [success(made, rows, seed) for rows in (np.ones(data.n_steps, dtype=bool), kept, short, ~made.bad)]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=at_least(1), default=5)
    options = parser.parse_args(arguments)
    lines = []
    for family in FAMILIES:
        cells = np.array([cell(family, seed) for seed in range(options.seeds)])
        gains = cells[:, 1] - cells[:, 0]
        lines.append([family, *(f"{100 * mean:.0f}" for mean in cells.mean(axis=0)), f"{100 * gains.min():+.0f}"])
        print(*lines[-1], sep=" | ", flush=True)
    header = ["success in %", "all rows", "without named segments", "shorter half", "by the truth", "worst seed"]
    print(table(header, lines), line(provenance(f"0 to {options.seeds - 1}")), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
