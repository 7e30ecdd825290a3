"""What each constant of the judge is worth: what it says with another value, or without its rule, family by family.

    python benchmarks/ablations.py --data ../shared/data --json ablations.json --processes 2
    python benchmarks/ablations.py --quick

First without answers; then after eight random labels, for the constants of answers. A variant is written to the JSON
when it is done, and not done again for the same commit. A rule stays where a family gains by it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import answers
import claims
from claims import Job, Row, auroc
from options import asked, output, write_json
from provenance import line, provenance
from rpil import Settings
from rpil.inference import outliers, scores
from rpil.inference.channels import normal_scores
from rpil.inference.settings import AnswerSettings, JudgeSettings
from worlds import kinds
from worlds.simulated import of_paper

DEFAULT = "the default"
DRAWS, LABELS = 5, 8
FAMILIES = ("recorded", "half", "walks", "point mass", "paper", "plain", *kinds.KINDS)
NEVER = 1e9
RANKS = "ranks, not distances"
WITHOUT: dict[str, tuple[Any, str, Callable[..., Any]]] = {
    "steps as independent": (scores, "dependence", lambda data, *_: np.zeros(data.n_demonstrations)),
    "few steps as many": (scores, "fewer_steps", lambda lengths, _: np.zeros(len(lengths))),
    "own rules are linear": (outliers, "neighbour_gain", lambda *_: -np.inf),
}
"""Rules without a setting: where each is, and what takes its place."""

RULES: dict[str, tuple[str, dict[str, Any]]] = {
    DEFAULT: ("", {}),
    "nobody far below (min_gap 1e9)": ("outliers", {"min_gap": NEVER}),
    "min_gap 3": ("outliers", {"min_gap": 3.0}),
    "min_gap 5": ("outliers", {"min_gap": 5.0}),
    "no group lies apart (min_distance 1e9)": ("outliers", {"min_distance": NEVER}),
    "min_distance 2": ("outliers", {"min_distance": 2.0}),
    "all that are low are outliers (max_own_gain 1e9)": ("outliers", {"max_own_gain": NEVER}),
    "max_own_gain .45": ("outliers", {"max_own_gain": 0.45}),
    "max_own_gain .15": ("outliers", {"max_own_gain": 0.15}),
    "all teach (share 1)": ("trimming", {"share": 1.0}),
    "one concentration step": ("trimming", {"max_iter": 1}),
    "one ridge, 1e-4": ("held_out", {"ridges": (1e-4,)}),
    "ten folds": ("held_out", {"max_folds": 10}),
    "five folds of few demonstrations too": ("held_out", {"max_left_out": 0}),
    "error bars as they are (noise_shares 1)": ("groups", {"noise_shares": (1.0,)}),
    "no prior on the spread of a group": ("groups", {"prior_spread": 1e-6}),
    **dict.fromkeys(WITHOUT, ("", {})),
    "no monotony": ("", {"monotony": 0.0}),
    "own variance of each demonstration (variance_steps 0)": ("", {"variance_steps": 0.0}),
}
ANSWERS: dict[str, AnswerSettings] = {
    DEFAULT: AnswerSettings(),
    "no prior on the ranking (by_ranking 0)": AnswerSettings(by_ranking=0.0),
    "no prior on the group (by_group 0)": AnswerSettings(by_group=0.0),
    RANKS: AnswerSettings(),
    "fixed places alone (max_lead 99)": AnswerSettings(max_lead=99),
    "precision 4": AnswerSettings(precision=4.0),
    "full_trust .7": AnswerSettings(full_trust=0.7),
    "min_proba .9": AnswerSettings(min_proba=0.9),
}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", default=Path(), help="folder of NPZ files; default: this")
    parser.add_argument("--json", type=output, metavar="OUT", help="where finished variants are kept")
    parser.add_argument("--match", action="append", metavar="NAME", help="only variants whose name begins with it")
    parser.add_argument("--families", default=",".join(FAMILIES), metavar="KINDS", help=f"of {', '.join(FAMILIES)}")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="one small world, few variants: checks the script")
    options = parser.parse_args(arguments)
    jobs = [Job("paper", "quick", partial(of_paper, "MountainCar-v0", "corrupted", 0))]
    if not options.quick:
        jobs = [job for job in jobs_of(options.data) if job.kind in options.families.split(",")]
    origin = provenance(f"0, {DRAWS} draws of labels", asked(parser, options))
    found: Row = {"provenance": origin, "unfinished": True, "rules": {}}
    if options.json and options.json.exists():
        old: Row = json.loads(options.json.read_text(encoding="utf-8"))
        same = all(old["provenance"].get(key) == origin[key] for key in ("commit", "dirty", "arguments"))
        found = old if same else found
    with Pool(options.processes, maxtasksperchild=20) as pool:
        wanted = [name for name in RULES if name.startswith(tuple(options.match or ("",)))]
        for name in [name for name in wanted if name not in found["rules"]][: 3 if options.quick else None]:
            found["rules"][name] = pool.map(partial(audited, name), jobs, chunksize=1)
            if options.json:
                write_json(options.json, found)
        labelled_jobs = [job for job in jobs if job.kind in ("recorded", "paper")]
        audits = pool.map(answers.audited, labelled_jobs, chunksize=1)
    found |= {"answers": {name: labelled(audits, name) for name in ANSWERS}, "unfinished": False}
    if options.json:
        write_json(options.json, found)
    print(f"{markdown(found)}\n\n{line(found['provenance'])}")
    return 0


def audited(name: str, job: Job) -> Row:
    """A row of `claims` with other values."""
    stage, values = RULES[name]
    judge = JudgeSettings()
    judge = replace(judge, **({stage: replace(getattr(judge, stage), **values)} if stage else values))
    with patch.object(*WITHOUT[name]) if name in WITHOUT else nullcontext():
        return claims.audited(job, Settings(judge=judge))


def jobs_of(folder: Path) -> list[Job]:
    """Recorded sets, halves of them in which nobody is bad, walks, one draw of each world of a point mass and of each
    cell of the paper, plain worlds, and the kinds of `worlds/kinds.py`."""
    every = [job for job in claims.jobs(folder, 1, 2) if job.kind in FAMILIES]
    every += [job for job in claims.jobs(None, 20, 0) if job.kind == "walks"][1:]
    return [job for job in every if job.kind != "point mass" or job.name.endswith("12 of 40, 1")]


def labelled(audits: list[Row], name: str) -> list[Row]:
    """Words for the rest of each set after random labels, and after those that are asked for."""
    rows, settings = [], ANSWERS[name]
    for audit in audits:
        if name == RANKS:
            ranks = normal_scores(audit["log_odds"][:, None])
            audit = audit | {"columns": np.column_stack([ranks, audit["columns"][:, 1:]])}
        draws = [answers.drawn(audit["good"], LABELS, np.random.default_rng(draw)) for draw in range(DRAWS)]
        asked = draws[0] if draws[0] is None else answers.suggested(audit, LABELS, settings)
        for n, chosen in enumerate([*draws, asked]):
            if chosen is not None:
                rest = answers.rest_of(audit, chosen)
                found = answers.labelled(audit, chosen, settings=settings)
                good, verdicts = audit["good"][rest].tolist(), found.verdicts[rest].tolist()
                row = {"good": good, "verdicts": verdicts, "log_odds": found.log_odds[rest].tolist()}
                rows.append(row | {"asked": n == DRAWS})
    return rows


def markdown(result: Row) -> str:
    """The section of docs/results.md."""
    text = "The columns *recorded* and *paper* have the bad and the good demonstrations that are outliers or of a "
    text += "group apart, and the mean AUROC. *Half*, where nobody is bad, has the good ones that are outliers."
    families = [
        family for family in FAMILIES if any(row["kind"] == family for row in next(iter(result["rules"].values())))
    ]
    head = ["| variant | " + " | ".join(families) + " |", "|---|" + "---|" * len(families)]
    rules = [f"| {name} | {' | '.join(cells(rows, families))} |" for name, rows in result["rules"].items()]
    others = f"Recorded sets and the paper's cells, after {LABELS} random labels, or {LABELS} that are asked for:"
    parts = ["## Ablations", "", text, "", *head, *rules, "", others, ""]
    parts += ["| variant | with a verdict | wrong | AUROC | asked: with a verdict | wrong | bad ones named |"]
    parts += ["|---|---|---|---|---|---|---|"]
    return "\n".join([*parts, *(told(name, rows) for name, rows in result["answers"].items())])


def cells(rows: list[Row], families: list[str]) -> Iterator[str]:
    """What is said of each family."""
    for family in families:
        own = [row for row in rows if row["kind"] == family]
        good, outlier, apart = (np.concatenate([row[name] for row in own]) for name in ("good", "verdicts", "apart"))
        if good.min() > 0:
            yield f"{(outlier < 0).sum()}"
            continue
        named = (outlier < 0) | (apart > 0)
        value = np.nanmean([auroc(np.array(row["good"]), np.array(row["log_odds"])) for row in own])
        yield f"{(named & (good == 0)).sum()}, {(named & (good == 1)).sum()}; {value:.3f}"


def told(name: str, rows: list[Row]) -> str:
    """A row of the table of answers."""
    random, asked = ([row for row in rows if row["asked"] == each] for each in (False, True))
    values = [auroc(np.array(row["good"]), np.array(row["log_odds"])) for row in random]
    mean = np.nanmean(values) if values else np.nan
    (said, wrong, _), (said_asked, wrong_asked, named) = words(random), words(asked)
    return f"| {name} | {said} | {wrong} | {mean:.3f} | {said_asked} | {wrong_asked} | {named} |"


def words(rows: list[Row]) -> tuple[str, str, str]:
    """The share with a verdict, that of wrong ones, and how many of the bad ones are bad."""
    good, verdicts = (np.concatenate([row[of] for row in rows]) if rows else np.zeros(0) for of in ("good", "verdicts"))
    wrong, said = (verdicts * (2 * good - 1) < 0).sum(), (verdicts != 0).sum()
    named = f"{((verdicts < 0) & (good == 0)).sum()} of {(good == 0).sum()}"
    return f"{said / max(len(good), 1):.0%}", f"{wrong / max(said, 1):.1%}", named


if __name__ == "__main__":
    sys.exit(main())
