"""What an audit says without answers, and whether it is right: words, pairs, and what does not change them.

    python benchmarks/claims.py --data ../shared/data --json claims.json
    python benchmarks/claims.py --data ../shared/data --only half,walks
    python benchmarks/claims.py --quick

Kinds of data: `recorded` sets with good and bad demonstrations; the good `half` of each alone; `walks`, made with one
law that is not linear; the paper's cells (`paper`) and the `grid` of simulated kinds; `changes` of recorded sets that
are not behaviour, and a random half of the demonstrations. The truth `is_good` scores and is never read by the audit.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from provenance import line, provenance
from rpil import RPIL
from rpil.data.demonstrations import Demonstrations
from rpil.simulation.simulate import simulate
from trust_data import data_cells
from trust_worlds import cells

Array = NDArray[Any]
Row = dict[str, Any]
KINDS = ("recorded", "half", "walks", "paper", "grid", "changes")
PAPER = tuple(product(("MountainCar-v0", "LunarLander-v3", "Acrobot-v1"), ("corrupted", "random")))
P_BINS = (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)
"""Edges of the bins of P(typical) in which good demonstrations are counted."""
CHANGED_SETS = ("metaworld_window_open", "metaworld_push", "rilco_hopper_mix", "vild_walker2d", "human_mountaincar")


@dataclass(frozen=True)
class Job:
    """One audit: its kind, its name, and what makes its data."""

    kind: str
    name: str
    make: Callable[[], tuple[Demonstrations, Array]]
    """Demonstrations, and 1 good, 0 bad, -1 in between for each."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of NPZ files")
    parser.add_argument("--only", default=",".join(KINDS), metavar="KINDS", help=f"of {', '.join(KINDS)}")
    parser.add_argument("--draws", type=int, default=20, help="draws of each cell of the paper, and walks")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="OUT", help="also write every row")
    parser.add_argument("--quick", action="store_true", help="few small worlds: checks the script")
    options = parser.parse_args(arguments)
    if not (options.data or options.quick):
        parser.error("say where the NPZ files are: --data DIR.")
    wanted = set(options.only.split(","))
    every = [job for job in jobs(options.data, 1 if options.quick else options.draws) if job.kind in wanted]
    if options.quick:
        every = [job for job in every if job.kind in ("walks", "paper")][:3]
    with Pool(options.processes, maxtasksperchild=20) as pool:
        rows = list(pool.imap_unordered(audited, every))
    rows.sort(key=lambda row: (KINDS.index(row["kind"]), row["name"]))
    print("\n".join(report(rows)))
    if options.json:
        options.json.write_text(json.dumps({"provenance": provenance(options.draws), "rows": rows}))
    print(f"\n{line(provenance(options.draws))}")
    return 0


# ---- the data --------------------------------------------------------------------------------------------------------


def jobs(folder: Path | None, draws: int) -> Iterator[Job]:
    """Every audit."""
    for name, cell in (data_cells(folder)[0] if folder else {}).items():
        yield Job("recorded", name, partial(world_of, cell))
        yield Job("half", name, partial(good_half, cell))
        if name in CHANGED_SETS:
            for change in CHANGES:
                yield Job("changes", f"{name}: {change}", partial(changed, cell, change))
    for seed in range(draws):
        yield Job("walks", f"walks {seed}", partial(walks, seed))
    for (env, kind), seed in product(PAPER, range(draws)):
        yield Job("paper", f"{env} {kind} {seed}", partial(of_paper, env, kind, seed))
    for name, cell in cells(["simulated"]).items():
        if cell.arguments[-1] == 1000:
            yield Job("grid", name, partial(world_of, cell))


def world_of(cell: Any) -> tuple[Demonstrations, Array]:
    world = cell.make()
    return world.demonstrations, world.is_good


def good_half(cell: Any) -> tuple[Demonstrations, Array]:
    """The good demonstrations alone."""
    demonstrations, good = world_of(cell)
    kept = np.flatnonzero(good == 1)
    return demonstrations.select(kept), good[kept]


def walks(seed: int) -> tuple[Demonstrations, Array]:
    """Random walks in a state space; all act by tanh(x W) with a noise of .1."""
    rng = np.random.default_rng([7, seed])
    size, weights = int(rng.integers(20, 51)), rng.normal(size=(6, 3))
    states = np.cumsum(0.2 * rng.normal(size=(size, 200, 6)), axis=1) + rng.normal(size=(size, 1, 6))
    actions = np.tanh(states @ weights) + 0.1 * rng.normal(size=(size, 200, 3))
    made = Demonstrations.from_episodes(zip(states, actions, strict=True))
    return made, np.ones(size, dtype=int)


def of_paper(env: str, kind: str, seed: int) -> tuple[Demonstrations, Array]:
    made = simulate(env, kind, n_good=10, n_bad=10, seed=seed)
    return Demonstrations.from_episodes(made.episodes), np.asarray(made.is_good, dtype=int)


def changed(cell: Any, change: str) -> tuple[Demonstrations, Array]:
    """A recorded set after a change that is not behaviour; the demonstrations of the set keep their numbers as ids."""
    world = cell.make()
    rng = np.random.default_rng(0)
    states, actions, ids = CHANGES[change](world.observations.astype(float), world.actions, world.episode_ids, rng)
    made = Demonstrations.from_groups(states, actions, ids)
    return made, world.is_good[np.array(made.ids) % len(world.is_good)]


def noise_columns(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    return np.column_stack([states, rng.normal(size=(len(states), 5))]), actions, ids


def wild(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """The shortest demonstration is off by 1,000 standard deviations."""
    shortest = ids == np.bincount(ids).argmin()
    return states + 1000 * states.std(axis=0) * shortest[:, None], actions, ids


def twice(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    return np.tile(states, (2, 1)), np.concatenate([actions, actions]), np.concatenate([ids, ids + ids.max() + 1])


def copied(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """The shortest demonstration ten times more."""
    rows = np.flatnonzero(ids == np.bincount(ids).argmin())
    more = np.tile(rows, 10)
    new = np.repeat(ids.max() + 1 + np.arange(10), len(rows))
    return np.concatenate([states, states[more]]), np.concatenate([actions, actions[more]]), np.append(ids, new)


def halved(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """A random half of the demonstrations."""
    kept = rng.permutation(ids.max() + 1)[: ids.max() // 2 + 1]
    rows = np.isin(ids, kept)
    return states[rows], actions[rows], ids[rows]


def rotated(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    scaled = (states - states.mean(axis=0)) / (states.std(axis=0) + 1e-9)
    return scaled @ np.linalg.qr(rng.normal(size=(states.shape[1],) * 2))[0], actions, ids


def unchanged(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    return states, actions, ids


CHANGES: dict[str, Callable[..., tuple[Array, Array, Array]]] = {
    "as it is": unchanged,
    **{f"seed {seed}": unchanged for seed in range(1, 4)},
    "five columns of noise": noise_columns,
    "one off by 1,000 sd": wild,
    "all twice": twice,
    "one copied ten times": copied,
    "states rotated": rotated,
    "a random half": halved,
}


# ---- an audit --------------------------------------------------------------------------------------------------------


def audited(job: Job) -> Row:
    """One audit as plain numbers."""
    demonstrations, good = job.make()
    seed = int(job.name[-1]) if "seed" in job.name else 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        audit = RPIL(random_state=seed).fit(demonstrations).audit_
    words = [{"typical": 1, "open": 0, "unlike": -1}[verdict] for verdict in audit.verdicts]
    pair = [int(good[audit.index(name)]) for name in audit.pair]
    values = {"good": good.tolist(), "words": words, "log_odds": audit.log_odds.tolist(), "pair": pair}
    values["ids"] = list(audit.ids) if job.kind == "changes" else []
    values["proba"] = audit.expert_proba.tolist()
    return {"kind": job.kind, "name": job.name, "finding": audit.finding, "doubts": list(audit.doubts), **values}


def auroc(good: Array, score: Array) -> float:
    """Probability that a good demonstration scores above a bad one, ties half; NaN without both."""
    above, below = score[good == 1][:, None], score[good == 0]
    return float(((above > below) + 0.5 * (above == below)).mean()) if above.size and below.size else np.nan


# ---- the report ------------------------------------------------------------------------------------------------------


def markdown(result: Row) -> str:
    """The section of docs/results.md."""
    explained = "Words without answers, by the truth that no audit reads: `unlike` counts as bad, `typical` as good."
    return "\n".join(["## Claims without answers", "", explained, "", *report(result["rows"])])


def report(rows: list[Row]) -> list[str]:
    """Tables in Markdown."""
    lines = [
        "| kind | sets | unlike: bad, good | typical: good, bad | sets with a good one unlike | share with a word |"
    ]
    lines.append("|---|---|---|---|---|---|")
    for kind in KINDS:
        own = [row for row in rows if row["kind"] == kind]
        if kind == "recorded":
            ranked = [(row, auroc(np.array(row["good"]), np.array(row["log_odds"]))) for row in own]
            lines += counted("recorded, AUROC >= .6", [row for row, value in ranked if value >= 0.6])
            lines += counted("recorded, AUROC < .6", [row for row, value in ranked if value < 0.6])
        elif kind == "paper":
            for env, error in PAPER:
                cell = f"{env} {error}"
                lines += counted(f"paper: {cell}", [row for row in own if row["name"].startswith(cell)])
        elif kind != "changes":
            lines += counted(kind, own)
    grid = [row for row in rows if row["kind"] == "grid"]
    if grid:
        right = [row for row in grid if is_right(row)]
        discrete = [row for row in grid if "Continuous" not in row["name"] and "Pendulum" not in row["name"]]
        n_right = sum(row in right for row in discrete)
        text = f"Cells of the grid that are right: {n_right} of {len(discrete)} discrete, "
        lines += ["", f"{text}{len(right) - n_right} of {len(grid) - len(discrete)} continuous."]
    recorded = [row for row in rows if row["kind"] == "recorded" and len(row["pair"]) == 2]
    if recorded:
        one_each = sum(set(row["pair"]) == {0, 1} for row in recorded)
        middle = sum(-1 in row["pair"] for row in recorded)
        lines += [
            "",
            f"The pair asked holds one good and one bad in {one_each} of {len(recorded)} recorded sets; one of ",
        ]
        lines[-1] += f"middling quality in {middle}."
    return lines + good_by_proba(rows) + changes(rows) + ["", *described(rows)]


def good_by_proba(rows: list[Row]) -> list[str]:
    """How many demonstrations of recorded sets with such a P(typical) are good; those of middling quality are left out.

    `rpil.audit.words` quotes the last line.
    """
    recorded = [row for row in rows if row["kind"] == "recorded"]
    if not recorded:
        return []
    good, proba = (np.concatenate([row[name] for row in recorded]) for name in ("good", "proba"))
    source = np.repeat(np.arange(len(recorded)), [len(row["good"]) for row in recorded])[good >= 0]
    good, proba = good[good >= 0], proba[good >= 0]
    which = np.clip(np.searchsorted(P_BINS, proba, side="right") - 1, 0, len(P_BINS) - 2)
    lines = ["", "| P(typical) | demonstrations | good | share good | sets |", "|---|---|---|---|---|"]
    for k, (low, high) in enumerate(pairwise(P_BINS)):
        own = which == k
        share = f"{good[own].mean():.0%}" if own.any() else ""
        counts = f"{own.sum()} | {good[own].sum()} | {share} | {len(set(source[own]))}"
        lines.append(f"| {low:g} to {high:g} | {counts} |")
    most, least = good[proba >= 0.9], good[proba <= 0.1]
    if len(most) and len(least):
        text = f"{most.mean():.0%} of the demonstrations with P(typical) of .9 or more were good, "
        text += f"{least.mean():.0%} of those with .1 or less, and {good.mean():.0%} of all"
        lines += ["", f"In {len(recorded)} recorded sets {text}."]
    return lines


def counted(title: str, rows: list[Row]) -> list[str]:
    """A row of the first table."""
    if not rows:
        return []
    pairs = [(np.array(row["good"]), np.array(row["words"])) for row in rows]
    count = {
        (word, truth): sum(int(((words == word) & (good == truth)).sum()) for good, words in pairs)
        for word, truth in product((1, -1), (1, 0))
    }
    sets = sum(bool(((words < 0) & (good == 1)).any()) for good, words in pairs)
    shares = np.array([float((words[good >= 0] != 0).mean()) for good, words in pairs])
    error = shares.std(ddof=1) / np.sqrt(len(shares)) if len(shares) > 1 else np.nan
    of_good = sum(int((good == 1).sum()) for good, _ in pairs)
    unlike = f"{count[-1, 0]}, {count[-1, 1]} of {of_good} good"
    return [
        f"| {title} | {len(rows)} | {unlike} | {count[1, 1]}, {count[1, 0]} | {sets} | "
        f"{shares.mean():.2f} (standard error {error:.2f}) |"
    ]


def is_right(row: Row) -> bool:
    """AUROC >= .99, words for 80 % and none wrong; of flipped and shifted actions: the pair holds one of each."""
    good, words = np.array(row["good"]), np.array(row["words"])
    if " flip " in row["name"] or " shift " in row["name"]:
        return set(row["pair"]) == {0, 1} and not (words != 0).any()
    wrong = ((words > 0) & (good == 0)) | ((words < 0) & (good == 1))
    return auroc(good, np.array(row["log_odds"])) >= 0.99 and (words != 0).mean() >= 0.8 and not wrong.any()


def changes(rows: list[Row]) -> list[str]:
    """How many words change where nothing that matters does; of a random half, those that its demonstrations had."""
    own = {row["name"]: row for row in rows if row["kind"] == "changes"}
    bases = {name.split(":")[0]: row["words"] for name, row in own.items() if name.endswith("as it is")}
    if not bases:
        return []
    lines = ["", "| change | words given | turned over | withdrawn |", "|---|---|---|---|"]
    for change in CHANGES:
        rows_of = ((words, own[f"{name}: {change}"]) for name, words in bases.items())
        pairs = [
            (words[m], word)
            for words, row in rows_of
            for m, word in zip(row["ids"], row["words"], strict=False)
            if m < len(words)
        ]
        given = sum(old != 0 for old, _ in pairs)
        turned = sum(old * new < 0 for old, new in pairs)
        gone = sum(old != 0 and new == 0 for old, new in pairs)
        lines.append(f"| {change} | {given} | {turned} | {gone} |")
    return lines


def described(rows: list[Row]) -> list[str]:
    """A line for each recorded set, and for each other audit with a wrong word."""
    lines = []
    for row in rows:
        good, words = np.array(row["good"]), np.array(row["words"])
        wrong = int((((words > 0) & (good == 0)) | ((words < 0) & (good == 1))).sum())
        if row["kind"] == "recorded" or (wrong and row["kind"] != "changes"):
            value = auroc(good, np.array(row["log_odds"]))
            text = f"AUROC {value:.2f}, {row['finding']}, {int((words != 0).sum())} words, {wrong} wrong"
            lines.append(f"- {row['kind']} {row['name']}: {text}. {' '.join(row['doubts'])}")
    return lines


if __name__ == "__main__":
    sys.exit(main())
