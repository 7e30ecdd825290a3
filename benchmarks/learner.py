"""How near `RPIL()` comes to a policy of the good demonstrations alone, as the share of bad ones grows.

    python benchmarks/learner.py --processes 2                 # classes, numbers, and a pole that is balanced
    python benchmarks/learner.py --data ../shared/data         # the weight of good ones in recorded sets, too
    python benchmarks/learner.py --quick

Bad ones guess, act against the expert, follow another rule, press one button, act with noise or half as far; on the
pole they press at random, seek the centre or mistake a sign. Each cell is a mean over two seeds, of 20 demonstrations
over six. Of classes the figure is the share of fresh states with the expert's likeliest action, of numbers the root
mean square error.
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

import gymnasium
import numpy as np

from options import asked
from provenance import line, provenance
from rpil import RPIL, BehavioralCloning
from rpil.data.demonstrations import Demonstrations
from worlds import Array, World
from worlds.recorded import read, recorded_sets

Row = dict[str, Any]
EXPERT, OTHER = (1.5 * np.random.default_rng(seed).normal(size=(5, 4)) for seed in (7, 99))
FRESH = np.random.default_rng(5).normal(size=(4000, 5))
CLASSES = ("guess", "against", "other rule", "one button")
NUMBERS = ("noise", "against", "other rule", "half")
SHARES, SIZES, SEEDS = (0.0, 0.1, 0.3, 0.45, 0.6), (20, 100), {20: 6, 100: 2, 500: 2}
RULE, LARGE, OF_SIZES = "other rule", 500, (0.1, 0.3)
"""Bad ones of whom there are so many demonstrations, too, and the shares for which distances are printed."""
NEAR = {"classes": 0.02, "numbers": 0.03}
N_STEPS, N_EPISODES, SLIP, HELD = 150, 20, 0.05, 450
RULES: dict[str, Callable[[Array, np.random.Generator], int]] = {
    "expert": lambda state, rng: int(3 * state[2] + state[3] > 0),
    "random": lambda state, rng: int(rng.integers(2)),
    "centre": lambda state, rng: int(state[0] + state[1] < 0),
    "sign": lambda state, rng: int(3 * state[2] - state[3] > 0),
}


def classes(kind: str, rng: np.random.Generator) -> tuple[Array, Array]:
    states = rng.normal(size=(30, 5))
    rule = {"against": -EXPERT, "other rule": OTHER}.get(kind, EXPERT)
    taken = (states @ rule + rng.gumbel(size=(30, 4))).argmax(axis=1)
    if kind == "guess":
        taken = rng.integers(0, 4, 30)
    return states, np.where(rng.random(30) < 0.8, 1, taken) if kind == "one button" else taken


def numbers(kind: str, rng: np.random.Generator) -> tuple[Array, Array]:
    states, rule = rng.normal(size=(40, 5)), EXPERT[:, :2] / 1.5
    rule = {"against": -rule, "other rule": OTHER[:, :2] / 1.5, "half": 0.4 * rule}.get(kind, rule)
    return states, states @ rule + (1.5 if kind == "noise" else 0.1) * rng.normal(size=(40, 2))


def world(make: Callable[..., Any], kind: str, n: int, share: float, seed: int) -> World:
    """`n` demonstrations, of which the first ones, a `share`, are bad."""
    bad = np.arange(n) < round(share * n)
    episodes = [make(kind if bad[m] else "", np.random.default_rng([41, seed, m])) for m in range(n)]
    return World.of(Demonstrations.from_episodes(episodes), ~bad)


def cell(given: tuple[str, str, int, float]) -> Row:
    """The figures of RPIL(), of all demonstrations alike, and of the good ones alone; at 60 % with four labels too."""
    of, kind, n, share = given
    figures: dict[str, list[float]] = {}
    for seed in range(SEEDS[n]):
        made = world(classes if of == "classes" else numbers, kind, n, share, seed)
        data, good = made.demonstrations, made.is_good
        fits = {"RPIL()": RPIL().fit(data), "all": BehavioralCloning().fit(data)}
        fits["good alone"] = BehavioralCloning().fit(data.select(np.flatnonzero(good)))
        if share > 0.5:
            names = [data.ids[m] for m in (*np.flatnonzero(good == 0)[:2], *np.flatnonzero(good)[:2])]
            labels = dict(zip(names, ("bad", "bad", "good", "good"), strict=True))
            fits["four labels"] = RPIL().fit(data, labels=labels)
        for name, fit in fits.items():
            figures.setdefault(name, []).append(score(of, fit.predict(FRESH)))
    means = {name: float(np.mean(values)) for name, values in figures.items()}
    return {"of": of, "kind": kind, "n": n, "share": share, **means}


def score(of: str, predicted: Array) -> float:
    if of == "classes":
        return float((predicted == (FRESH @ EXPERT).argmax(axis=1)).mean())
    return float(np.sqrt(np.mean((predicted - FRESH @ EXPERT[:, :2] / 1.5) ** 2)))


def pole(given: tuple[str, int, float]) -> Row:
    """Mean steps for which the policies of RPIL(), and of all alike, hold a pole; 500 at most."""
    kind, n, share = given
    env, episodes = gymnasium.make("CartPole-v1"), []
    for m in range(n):
        rng, rows = np.random.default_rng([71, m]), []
        state, _ = env.reset(seed=90_000 + m)
        for _ in range(N_STEPS):
            rule = RULES[kind if m < round(share * n) else "expert"]
            action = int(rng.integers(2)) if rng.random() < SLIP else rule(state, rng)
            rows.append((state, action))
            state, _, fell, late, _ = env.step(action)
            if fell or late:
                state, _ = env.reset(seed=int(rng.integers(1 << 30)))
        episodes.append(tuple(map(np.array, zip(*rows, strict=True))))
    data = Demonstrations.from_episodes(episodes)
    held = {"RPIL()": driven(env, RPIL().fit(data)), "all": driven(env, BehavioralCloning().fit(data))}
    return {"of": "pole", "kind": kind, "n": n, "share": share, **held}


def driven(env: Any, policy: Any) -> float:
    """Mean steps of some episodes."""
    steps = []
    for k in range(N_EPISODES):
        state, over, n = env.reset(seed=70_000 + k)[0], False, 0
        while not over:
            state, _, fell, late, _ = env.step(int(policy.predict(state[None])[0]))
            over, n = fell or late, n + 1
        steps.append(n)
    return float(np.mean(steps))


def weighed(path: Path) -> Row | None:
    """The share of the weight on good demonstrations of a recorded set, less their share."""
    made = read(path)
    known = made.is_good >= 0
    if {*made.is_good[known].tolist()} != {0, 1}:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        audit = RPIL().fit(made.demonstrations).audit_
    weight = np.add.reduceat(audit.step_weight, audit.offsets[:-1]) / audit.lengths
    share = float((made.is_good[known] == 1).mean())
    gain = float(weight[known] @ (made.is_good[known] == 1) / max(weight[known].sum(), 1e-9) - share)
    return {"of": "recorded", "kind": path.stem, "share": share, "gain": gain}


def report(rows: list[Row]) -> list[str]:
    """Counts of the cells that come near, every cell that does not, and the recorded sets."""
    lines = []
    for of, near in NEAR.items():
        own = [row for row in rows if row["of"] == of]
        for share in dict.fromkeys(row["share"] for row in own):
            cells = [row for row in own if row["share"] == share]
            for name in ("RPIL()", "all", "four labels"):
                known = [row for row in cells if name in row]
                count = sum(worse(row, name) <= near for row in known)
                lines += [f"| {of} | {share:.0%} | {name} | {count} of {len(known)} |"] * bool(known)
    lines = ["| actions | bad | policy | cells near that of the good ones alone |", "|---|---|---|---|", *lines, ""]
    lines += distances(rows)
    poles = [row for row in rows if row["of"] == "pole"]
    for name in ("RPIL()", "all"):
        count = sum(row[name] >= HELD for row in poles)
        lines += [f"Pole, {name}: {count} of {len(poles)} cells hold it for {HELD} steps or more."] * bool(poles)
    sets = [row for row in rows if row["of"] == "recorded"]
    if sets:
        gains, most = np.array([row["gain"] for row in sets]), np.array([row["share"] for row in sets]) >= 0.55
        text = f"Recorded sets: weight on good ones less their share {gains.mean():+.3f} in the mean, better by .05 in "
        text += (
            f"{(gains > 0.05).sum()} of {len(gains)}, worse by .05 in {(gains < -0.05).sum()} (of {most.sum()} with "
        )
        lines.append(f"{text}55 % good or more {(gains < -0.05)[most].sum()}), worst {gains.min():+.2f}.")
    return lines


def worse(row: Row, name: str) -> float:
    """By how much a policy is worse than that of the good ones alone; below 0 where it is better."""
    return float((1 if row["of"] == "classes" else -1) * (row["good alone"] - row[name]))


def distances(rows: list[Row]) -> list[str]:
    """How much worse `RPIL()` is than the good ones alone, by the number of demonstrations."""
    sizes = (*SIZES, LARGE)
    lines = [f"| {RULE}, bad | {' | '.join(map(str, sizes))} |", "|---|" + "---|" * len(sizes)]
    for of, share in product(NEAR, OF_SIZES):
        found = {row["n"]: row for row in rows if (row["of"], row.get("kind"), row["share"]) == (of, RULE, share)}
        figures = [f"{worse(found[n], 'RPIL()'):+.3f}" if n in found else "" for n in sizes]
        lines.append(f"| {of}, {share:.0%} | {' | '.join(figures)} |")
    return [*lines, ""]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of NPZ files")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--json", type=Path, metavar="OUT", help="also write every row")
    parser.add_argument("--quick", action="store_true", help="three cells: checks the script")
    options = parser.parse_args(arguments)
    cells = [
        (of, *rest)
        for of, kinds in (("classes", CLASSES), ("numbers", NUMBERS))
        for rest in product(kinds, SIZES, SHARES)
    ]
    cells += [(of, RULE, LARGE, share) for of, share in product(NEAR, OF_SIZES)]
    poles = [*product(("random", "centre", "sign"), (20, 60), (0.2, 0.4))]
    if options.quick:
        cells, poles = [("classes", "other rule", 20, 0.3), ("numbers", "against", 20, 0.6)], [("sign", 20, 0.2)]
    jobs = [*(partial(cell, given) for given in cells), *(partial(pole, given) for given in poles)]
    jobs += [partial(weighed, path) for path in (recorded_sets(options.data) if options.data else ())]
    with Pool(options.processes) as pool:
        rows = [row for row in pool.imap(_call, jobs) if row is not None]
    origin = provenance(f"0 to {max(SEEDS.values()) - 1}", asked(parser, options))
    print("\n".join([*report(rows), "", line(origin)]))
    if options.json:
        options.json.write_text(json.dumps({"provenance": origin, "rows": rows}))
    return 0


def _call(job: Callable[[], Row | None]) -> Row | None:
    return job()


if __name__ == "__main__":
    sys.exit(main())
