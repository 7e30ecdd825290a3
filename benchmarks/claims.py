"""What an audit says without answers, and whether it is right: verdicts, pairs, and what does not change them.

    python benchmarks/claims.py --data ../shared/data --json claims.json
    python benchmarks/claims.py --data ../shared/data --only half,walks
    python benchmarks/claims.py --only "point mass" --match sessions,calm
    python benchmarks/claims.py --quick

Kinds of data: `recorded` sets with good and bad demonstrations; the good `half` of each alone; `walks`, made with one
law that is not linear; the paper's cells (`paper`) and the `grid` of simulated kinds; `changes` of recorded sets that
are not behaviour, and a random half of the demonstrations; `people`, recorded sets whose
operators are known, not named and named; worlds of a `point mass`; and the kinds of `worlds/kinds.py`. The truth
`is_good` scores and is never read by the audit.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np

from options import asked
from provenance import line, provenance
from rpil import RPIL, Settings
from worlds import Array, World, kinds
from worlds.point_mass import ALL_DIFFER, BAD, GOOD, SIZES, point_mass
from worlds.recorded import AS_IT_IS, CHANGES, changed, read, recorded_sets
from worlds.simulated import PAPER, grid, of_grid, of_paper, walks

Row = dict[str, Any]
KINDS = ("recorded", "half", "walks", "paper", "grid", "changes", "people", "point mass", *kinds.KINDS)
P_BINS = (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)
"""Edges of the bins of P(similar) in which good demonstrations are counted."""
CHANGED_SETS = ("metaworld_window_open", "metaworld_push", "rilco_hopper_mix", "vild_walker2d", "human_mountaincar")
HEAD = (
    "| kind | sets | outlier: bad, good | similar: good, bad | sets with a good outlier | share with a verdict |",
    "|---|---|---|---|---|---|",
)


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
    for kind, (make, given) in kinds.KINDS.items():
        for each in given:
            yield Job(kind, " ".join([kind, *map(str, each)]), partial(make, *each))


def good_half(path: Path) -> World:
    return read(path).good_half()


def audited(job: Job, settings: Settings | None = None) -> Row:
    """One audit as plain numbers."""
    world = job.make()
    good = world.is_good
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = RPIL(random_state=job.seed, settings=settings)
        audit = model.fit(world.demonstrations, demonstrators=world.people if job.people else None).audit_
    verdicts = [{"similar": 1, "open": 0, "outlier": -1}[verdict] for verdict in audit.verdicts]
    pair = [int(good[audit.index(name)]) for name in audit.pair]
    values = {"good": good.tolist(), "verdicts": verdicts, "log_odds": audit.log_odds.tolist(), "pair": pair}
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
    explained = "Verdicts of audits without answers, against the truth: `outlier` counts as bad, `similar` as good."
    return "\n".join(["## Claims without answers", "", explained, "", *report(result["rows"])])


def report(rows: list[Row]) -> list[str]:
    """Tables in Markdown."""
    of_kind = {kind: [row for row in rows if row["kind"] == kind] for kind in KINDS}
    parts = [list(HEAD)]
    ranked = [(row, auroc(np.array(row["good"]), np.array(row["log_odds"]))) for row in of_kind["recorded"]]
    parts[0] += counted("recorded, AUROC >= .6", [row for row, value in ranked if value >= 0.6])
    parts[0] += counted("recorded, AUROC < .6", [row for row, value in ranked if value < 0.6])
    for kind in ("half", "walks"):
        parts[0] += counted(kind, of_kind[kind])
    for cell in map(" ".join, PAPER):
        parts[0] += counted(f"paper: {cell}", [row for row in of_kind["paper"] if row["name"].startswith(cell)])
    parts[0] += counted("grid", of_kind["grid"])
    parts += [cells_right(of_kind["grid"]), pairs_asked(of_kind["recorded"]), good_by_proba(of_kind["recorded"])]
    for told in ("not named", "named"):
        parts[0] += counted(f"operators {told}", [row for row in of_kind["people"] if row["name"].startswith(told)])
    for kind in kinds.KINDS:
        parts[0] += counted(kind, of_kind[kind])
    parts += [changes(of_kind["changes"]), point_masses(of_kind["point mass"])]
    told = [described(row) for row in of_kind["recorded"]]
    parts += [["<details><summary>Set by set</summary>"], told, ["</details>"]] if told else []
    return [text for part in parts if part for text in ("", *part)][1:]


def cells_right(rows: list[Row]) -> list[str]:
    if not rows:
        return []
    right = {kind: [is_right(row) for row in rows if is_continuous(row) == kind] for kind in (False, True)}
    discrete, continuous = (f"{sum(found)} of {len(found)}" for found in right.values())
    return [f"Cells of the grid that are right: {discrete} discrete, {continuous} continuous."]


def is_continuous(row: Row) -> bool:
    return "Continuous" in row["name"] or "Pendulum" in row["name"]


def pairs_asked(rows: list[Row]) -> list[str]:
    asked = [row["pair"] for row in rows if len(row["pair"]) == 2]
    if not asked:
        return []
    one_each, middle = sum(set(pair) == {0, 1} for pair in asked), sum(-1 in pair for pair in asked)
    text = f"The question names a good and a bad demonstration in {one_each} of {len(asked)} recorded sets, "
    return [f"{text}and one of middling quality in {middle}."]


def good_by_proba(rows: list[Row]) -> list[str]:
    """How many demonstrations with such a P(similar) are good, of recorded sets with verdicts: in the others P is 1/2.
    Those of middling quality are left out.

    `rpil.results.vocabulary` quotes the last line.
    """
    rows = [row for row in rows if any(row["verdicts"])]
    if not rows:
        return []
    good, proba = (np.concatenate([row[name] for row in rows]) for name in ("good", "proba"))
    source = np.repeat(np.arange(len(rows)), [len(row["good"]) for row in rows])[good >= 0]
    good, proba = good[good >= 0], proba[good >= 0]
    which = np.clip(np.searchsorted(P_BINS, proba, side="right") - 1, 0, len(P_BINS) - 2)
    lines = ["| P(similar) | demonstrations | good | share good | sets |", "|---|---|---|---|---|"]
    for k, (low, high) in enumerate(pairwise(P_BINS)):
        own = which == k
        share = f"{good[own].mean():.0%}" if own.any() else ""
        counts = f"{own.sum()} | {good[own].sum()} | {share} | {len(set(source[own]))}"
        lines.append(f"| {low:g} to {high:g} | {counts} |")
    most, least = good[proba >= 0.9], good[proba <= 0.1]
    if len(most) and len(least):
        text = f"{most.mean():.0%} of the demonstrations with P(similar) of .9 or more were good, "
        text += f"{least.mean():.0%} of those with .1 or less, and {good.mean():.0%} of all"
        lines += ["", f"In {len(rows)} recorded sets with verdicts {text}."]
    return lines


def counts(rows: Sequence[Row]) -> dict[tuple[int, int], int]:
    """Demonstrations by verdict (1 similar, -1 outlier) and truth (1 good, 0 bad)."""
    verdicts, good = (np.concatenate([row[name] for row in rows]) for name in ("verdicts", "good"))
    every = product((1, -1), (1, 0))
    return {(verdict, truth): int(((verdicts == verdict) & (good == truth)).sum()) for verdict, truth in every}


def counted(title: str, rows: Sequence[Row]) -> list[str]:
    """A row of the first table."""
    if not rows:
        return []
    count, pairs = counts(rows), [(np.array(row["good"]), np.array(row["verdicts"])) for row in rows]
    sets = sum(bool(((verdicts < 0) & (good == 1)).any()) for good, verdicts in pairs)
    shares = np.array([float((verdicts[good >= 0] != 0).mean()) for good, verdicts in pairs])
    error = shares.std(ddof=1) / np.sqrt(len(shares)) if len(shares) > 1 else np.nan
    of_good = sum(int((good == 1).sum()) for good, _ in pairs)
    outlier = f"{count[-1, 0]}, {count[-1, 1]} of {of_good} good"
    return [
        f"| {title} | {len(rows)} | {outlier} | {count[1, 1]}, {count[1, 0]} | {sets} | "
        f"{shares.mean():.2f} (standard error {error:.2f}) |"
    ]


def is_right(row: Row) -> bool:
    """AUROC >= .99, verdicts for 80 % and none wrong; of flipped and shifted actions: the pair holds one of each."""
    good, verdicts = np.array(row["good"]), np.array(row["verdicts"])
    if " flip " in row["name"] or " shift " in row["name"]:
        return set(row["pair"]) == {0, 1} and not (verdicts != 0).any()
    return auroc(good, np.array(row["log_odds"])) >= 0.99 and (verdicts != 0).mean() >= 0.8 and not n_wrong(row)


def n_wrong(row: Row) -> int:
    count = counts([row])
    return count[1, 0] + count[-1, 1]


def changes(rows: list[Row]) -> list[str]:
    """How many verdicts change where nothing that matters does; of a random half, those that its demonstrations had."""
    own = {row["name"]: row for row in rows}
    bases = {name.split(":")[0]: row["verdicts"] for name, row in own.items() if name.endswith(AS_IT_IS)}
    if not bases:
        return []
    lines = ["| change | verdicts given | turned over | withdrawn |", "|---|---|---|---|"]
    for change in CHANGES:
        rows_of = ((verdicts, own[f"{name}: {change}"]) for name, verdicts in bases.items())
        pairs = [
            (verdicts[m], verdict)
            for verdicts, row in rows_of
            for m, verdict in zip(row["ids"], row["verdicts"], strict=False)
            if m < len(verdicts)
        ]
        given = sum(old != 0 for old, _ in pairs)
        turned = sum(old * new < 0 for old, new in pairs)
        gone = sum(old != 0 and new == 0 for old, new in pairs)
        lines.append(f"| {change} | {given} | {turned} | {gone} |")
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
    """A line for a recorded set."""
    value, verdicts = auroc(np.array(row["good"]), np.array(row["log_odds"])), np.count_nonzero(row["verdicts"])
    text = f"AUROC {value:.2f}, {row['finding']}, {verdicts} verdicts, {n_wrong(row)} wrong"
    return " ".join([f"- {row['name']}: {text}.", *row["doubts"]])


if __name__ == "__main__":
    sys.exit(main())
