"""What an audit says without answers, and whether it is right: outliers, groups apart, and whom to look at first.

    python benchmarks/claims.py --data ../shared/data --json claims.json
    python benchmarks/claims.py --data ../shared/data --only half,walks
    python benchmarks/claims.py --only "point mass" --match sessions,calm
    python benchmarks/claims.py --quick

Kinds of data: `recorded` sets with good and bad demonstrations; the good `half` of each alone; `walks`, made with one
law that is not linear; the paper's cells (`paper`) and the `grid` of simulated kinds; `changes` of recorded sets that
are not behaviour, and a random half of the demonstrations; `people`, recorded sets whose
operators are known, not named and named; worlds of a `point mass`; `plain` worlds in which one thing grows; and the
kinds of `worlds/kinds.py`. The truth `is_good` scores and is never read by the audit. Beside the ranking stands that of
the judge of 0.3 (`rivals/judge_of_0_3.npz`).
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np

import rpil
from options import asked
from provenance import line, provenance
from rivals import judge_of_0_3
from rpil import RPIL, Settings
from rpil.results.answering import looking_order, n_first
from worlds import Array, World, kinds, plain
from worlds.point_mass import ALL_DIFFER, BAD, GOOD, SIZES, point_mass
from worlds.recorded import AS_IT_IS, CHANGES, changed, read, recorded_sets
from worlds.simulated import PAPER, grid, of_grid, of_paper, walks

Row = dict[str, Any]
KINDS = ("recorded", "half", "walks", "paper", "grid", "changes", "people", "point mass", "plain", *kinds.KINDS)
CHANGED_SETS = ("metaworld_window_open", "metaworld_push", "rilco_hopper_mix", "vild_walker2d", "human_mountaincar")
HEAD = (
    "| kind | sets | outlier: bad, good | apart: bad, good | first: bad | all: bad | sets with a good outlier |",
    "|---|---|---|---|---|---|---|",
)
LEAST, WELL, MIN_STEPS = 0.01, 0.99, 10
"""By how much a ranking may be lower than that of 0.3; AUROC from which somebody should be named in a cell of plain
worlds, and steps of its demonstrations."""


@dataclass(frozen=True)
class Job:
    """One audit: its kind, its name, and what makes its data."""

    kind: str
    name: str
    make: Callable[[], World]
    seed: int = 0
    people: bool = False
    """Whether the audit is told the demonstrators."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of NPZ files; without, made data alone")
    parser.add_argument("--only", default=",".join(KINDS), metavar="KINDS", help=f"of {', '.join(KINDS)}")
    parser.add_argument("--match", default="", metavar="NAMES", help="only audits whose name begins with one of these")
    parser.add_argument("--draws", type=int, default=20, help="of each cell of the paper, and walks")
    parser.add_argument("--seeds", type=int, default=4, help="of each world of a point mass")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="OUT", help="also write every row")
    parser.add_argument("--quick", action="store_true", help="few small worlds: checks the script")
    options = parser.parse_args(arguments)
    only, names = options.only.split(","), tuple(options.match.split(","))
    if unknown := sorted(set(only) - set(KINDS)):
        parser.error(f"there is no kind {', '.join(unknown)}: choose from {', '.join(KINDS)}.")
    draws, seeds = (1, 1) if options.quick else (options.draws, options.seeds)
    every = [job for job in jobs(options.data, draws, seeds) if job.kind in only and job.name.startswith(names)]
    if options.quick:
        every = [job for job in every if job.kind in ("walks", "paper")][:3]
    with Pool(options.processes, maxtasksperchild=20) as pool:
        rows = list(pool.imap_unordered(audited, every))
    rows.sort(key=lambda row: (KINDS.index(row["kind"]), row["name"]))
    origin = provenance(f"{draws} draws, {seeds} of each point mass", asked(parser, options))
    print("\n".join(report(rows)))
    if options.json:
        options.json.write_text(json.dumps({"provenance": origin, "rows": rows}))
    print(f"\n{line(origin)}")
    return 0


# ---- the audits ------------------------------------------------------------------------------------------------------


def jobs(folder: Path | None, draws: int, seeds: int) -> Iterator[Job]:
    """Every audit."""
    for path in recorded_sets(folder) if folder else ():
        name = path.stem
        yield Job("recorded", name, partial(read, path))
        yield Job("half", name, partial(good_half, path))
        if name in CHANGED_SETS:
            for change in CHANGES:
                seed = int(change[-1]) if change.startswith("seed") else 0
                yield Job("changes", f"{name}: {change}", partial(changed, path, change), seed)
        if 1 < len(set(people := read(path).people)) < len(people):
            for told in (False, True):
                yield Job("people", f"{'named' if told else 'not named'}: {name}", partial(read, path), people=told)
    for seed in range(draws):
        yield Job("walks", f"walks {seed}", partial(walks, seed))
    for (env, kind), seed in product(PAPER, range(draws)):
        yield Job("paper", f"{env} {kind} {seed}", partial(of_paper, env, kind, seed))
    for env, kind, share in grid():
        yield Job("grid", f"{env} {kind} {share} %", partial(of_grid, env, kind, share))
    for kind, discrete, size, seed in product((*BAD, *GOOD, *ALL_DIFFER), (False, True), SIZES, range(seeds)):
        what = f"{kind}, {'discrete' if discrete else 'continuous'}, {size[1]} of {size[0]}, {seed}"
        yield Job("point mass", what, partial(point_mass, kind, discrete, size, seed))
    for name, make in plain.cells():
        yield Job("plain", name, make)
    for kind, (make, given) in kinds.KINDS.items():
        for each in given:
            yield Job(kind, " ".join([kind, *map(str, each)]), partial(make, *each))


def good_half(path: Path) -> World:
    return read(path).good_half()


def audited(job: Job, settings: Settings | None = None) -> Row:
    """One audit as plain numbers."""
    world = job.make()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if job.people:
            audit = RPIL(settings=settings).fit(world.demonstrations, demonstrators=world.people).audit_
        else:
            audit = rpil.audit(world.demonstrations, random_state=job.seed, settings=settings)
    apart = {*audit.competing[1]} if audit.finding == "a group apart" else set()
    order = looking_order(audit)[0]
    return {
        "kind": job.kind,
        "name": job.name,
        "finding": audit.finding,
        "good": world.is_good.tolist(),
        "verdicts": [-int(verdict == "outlier") for verdict in audit.verdicts],
        "apart": [int(name in apart) for name in audit.ids],
        "first": order[: n_first(len(order))],
        "log_odds": audit.log_odds.tolist(),
        "pair": [int(world.is_good[audit.index(name)]) for name in audit.pair],
        "ids": list(audit.ids) if job.kind == "changes" else [],
        "n_steps": int(np.median(audit.lengths)),
    }


def auroc(good: Array, score: Array) -> float:
    """Probability that a good demonstration scores above a bad one, ties half; NaN without both."""
    above, below = score[good == 1][:, None], score[good == 0]
    return float(((above > below) + 0.5 * (above == below)).mean()) if above.size and below.size else np.nan


# ---- the report ------------------------------------------------------------------------------------------------------


def markdown(result: Row) -> str:
    """The section of docs/results.md."""
    explained = (
        "Audits without answers beside the truth: outliers, groups apart, and the first to look at. *Half* is the good "
        "half of each recorded set; *walks* are made by one curved rule without mistakes."
    )
    return "\n".join(["## Claims without answers", "", explained, "", *report(result["rows"])])


def report(rows: list[Row]) -> list[str]:
    """Tables in Markdown."""
    of_kind = {kind: [row for row in rows if row["kind"] == kind] for kind in KINDS}
    parts = [list(HEAD)]
    for kind in ("recorded", "half", "walks"):
        parts[0] += counted(kind, of_kind[kind])
    for cell in map(" ".join, PAPER):
        parts[0] += counted(f"paper: {cell}", [row for row in of_kind["paper"] if row["name"].startswith(cell)])
    parts[0] += counted("grid", of_kind["grid"])
    parts += [pairs_asked(of_kind["recorded"]), plain_cells(of_kind["plain"]), beside_0_3(rows)]
    for told in ("not named", "named"):
        parts[0] += counted(f"operators {told}", [row for row in of_kind["people"] if row["name"].startswith(told)])
    for kind in kinds.KINDS:
        parts[0] += counted(kind, of_kind[kind])
    parts += [changes(of_kind["changes"]), point_masses(of_kind["point mass"])]
    told = [described(row) for row in of_kind["recorded"]]
    parts += [["<details><summary>Set by set</summary>"], told, ["</details>"]] if told else []
    return [text for part in parts if part for text in ("", *part)][1:]


def pairs_asked(rows: list[Row]) -> list[str]:
    asked = [row["pair"] for row in rows if len(row["pair"]) == 2]
    if not asked:
        return []
    one_each, middle = sum(set(pair) == {0, 1} for pair in asked), sum(-1 in pair for pair in asked)
    text = f"The question names a good and a bad demonstration in {one_each} of {len(asked)} recorded sets. "
    return [f"{text}In {middle} sets it names one of middling quality."]


def counted(title: str, rows: Sequence[Row]) -> list[str]:
    """A row of the first table."""
    if not rows:
        return []
    good, outlier, apart = (np.concatenate([row[name] for row in rows]) for name in ("good", "verdicts", "apart"))
    first = np.concatenate([np.array(row["good"])[row["first"]] for row in rows])
    accused = sum(bool(((np.array(row["verdicts"]) < 0) & (np.array(row["good"]) == 1)).any()) for row in rows)
    cells = [f"{(said & (good == 0)).sum()}, {(said & (good == 1)).sum()}" for said in (outlier < 0, apart > 0)]
    bad_first, bad = ((truth == 0).sum() / max((truth >= 0).sum(), 1) for truth in (first, good))
    return [f"| {title} | {len(rows)} | {' | '.join(cells)} | {bad_first:.0%} | {bad:.0%} | {accused} |"]


def plain_cells(rows: list[Row]) -> list[str]:
    """In how many plain worlds with few bad ones and a right ranking nobody is named; and how many are, by size."""
    if not rows:
        return []
    mute, able, named, total, accused, n_good = [], 0, 0, 0, 0, 0
    for row in rows:
        good, said = np.array(row["good"]), (np.array(row["verdicts"]) < 0) | (np.array(row["apart"]) > 0)
        accused, n_good = accused + int((said & (good == 1)).sum()), n_good + int((good == 1).sum())
        if row["name"].startswith("size") and (good == 0).any():
            named, total = named + int((said & (good == 0)).sum()), total + int((good == 0).sum())
        few = 0.02 <= (good == 0).mean() <= 0.36 and row["n_steps"] >= MIN_STEPS
        if few and auroc(good, np.array(row["log_odds"])) >= WELL:
            able += 1
            mute += [row["name"]] if not (said & (good == 0)).any() else []
    text = "In plain worlds with a right ranking and 2 to 36 % bad demonstrations, the audit names nobody in "
    text += f"{len(mute)} of {able} cells" + f" ({'; '.join(mute)})" * bool(mute)
    text += f". It names {accused} of {n_good} good demonstrations"
    return [f"{text}, and {named} of {total} bad ones in worlds of several sizes."]


def beside_0_3(rows: list[Row]) -> list[str]:
    """Where the ranking is lower than that of 0.3."""
    before, lower, better, n = judge_of_0_3(), [], 0, 0
    for row in rows:
        good, old = np.array(row["good"]), before.get(f"{row['kind']}: {row['name']}")
        if old is None or len(old) != len(good) or not {0, 1} <= {*good.tolist()}:
            continue
        now, then = auroc(good, np.array(row["log_odds"])), auroc(good, old)
        n, better = n + 1, better + (now > then + LEAST)
        lower += [f"{row['name']} {then:.3f} to {now:.3f}"] if now < then - LEAST else []
    if not n:
        return []
    text = f"Compared with the judge of 0.3, the AUROC is lower by more than {LEAST} in {len(lower)} of {n} sets"
    return [f"{text}{f' ({chr(59).join(lower)})' * bool(lower)}, and higher in {better}."]


def changes(rows: list[Row]) -> list[str]:
    """How many outliers change where nothing that matters does; of a random half, those that its demonstrations had."""
    own = {row["name"]: row for row in rows}
    bases = {name.split(":")[0]: row["verdicts"] for name, row in own.items() if name.endswith(AS_IT_IS)}
    if not bases:
        return []
    lines = ["| change | outliers | withdrawn | new |", "|---|---|---|---|"]
    for change in CHANGES:
        rows_of = ((verdicts, own[f"{name}: {change}"]) for name, verdicts in bases.items())
        pairs = [
            (verdicts[m], verdict)
            for verdicts, row in rows_of
            for m, verdict in zip(row["ids"], row["verdicts"], strict=False)
            if m < len(verdicts)
        ]
        gone, new = (sum(pair == change for pair in pairs) for change in ((-1, 0), (0, -1)))
        lines.append(f"| {change} | {sum(old < 0 for old, _ in pairs)} | {gone} | {new} |")
    return lines


def point_masses(rows: list[Row]) -> list[str]:
    """A row for each kind of operator."""
    if not rows:
        return []
    of_kind = {kind: [row for row in rows if row["name"].split(",")[0] == kind] for kind in (*BAD, *GOOD, *ALL_DIFFER)}
    text = "Simulated worlds of a point mass; no setting was chosen on them. In `hard` some push only with full force."
    lines = [text, "", *HEAD]
    for kind, own in of_kind.items():
        lines += counted(kind, own)
    lines += counted("all with bad ones", [row for kind in BAD for row in of_kind[kind]])
    return lines + counted("nobody bad", [row for kind in (*GOOD, *ALL_DIFFER) for row in of_kind[kind]])


def described(row: Row) -> str:
    """A recorded set in a line."""
    good, said = np.array(row["good"]), np.array(row["verdicts"]) < 0
    value = auroc(good, np.array(row["log_odds"]))
    wrong = int((said & (good == 1)).sum())
    return f"- {row['name']}: AUROC {value:.2f}, {row['finding']}, {said.sum()} outliers, {wrong} of them good."


if __name__ == "__main__":
    sys.exit(main())
