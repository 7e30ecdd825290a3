"""What each constant of the judge is worth: the verdicts with another value, or without its rule, and without several.

    python benchmarks/ablations.py --data ../shared/data --json ablations.json --processes 2
    python benchmarks/ablations.py --quick

First without answers; then after eight random labels, for the constants of answers. A variant is written to the JSON
when it is done, and not done again for the same commit.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np

import answers
import claims
from claims import Job, Row
from options import asked, output, write_json
from provenance import line, provenance
from rpil import Settings
from rpil.data.fit_data import FitData
from rpil.inference import claims as inference
from rpil.inference.held_out import HeldOutModel, _Linear, held_out_model
from rpil.inference.rivals import SecondWay
from rpil.inference.settings import AnswerSettings, JudgeSettings
from worlds import kinds
from worlds.simulated import of_paper

DEFAULT = "the default"
DRAWS, LABELS = 5, 8
FAMILIES = ("recorded", "half", "point mass", "paper", *kinds.KINDS)


def deal_within_groups(model: _Linear, seed: int, data: FitData | None = None) -> HeldOutModel | None:
    """Other folds of other data alone, as `columns_within` asks for: the judge deals its own demonstrations once."""
    return None if data is None else held_out_model(data, seed, model.settings)


Change = tuple[str, dict[str, Any]] | tuple[Any, str, Callable[..., Any] | property]
"""Other values in one stage of the judge, or an object, the name of a function or property of it, and its replacement.
"""


RULES: dict[str, Change] = {
    "no rival groups (max_shared_gain 0)": ("rivals", {"max_shared_gain": 0.0}),
    "min_p_two .9": ("claims", {"min_p_two": 0.9}),
    "nobody by chance": (inference, "by_chance", lambda *_: None),
    "one dealing of the folds": (_Linear, "dealt_again", deal_within_groups),
    "no better half": (inference, "in_better_part", lambda scores, upper: upper),
    "no agreement (min_agreement -1)": ("claims", {"min_agreement": -1.0}),
    "all teach (share 1)": ("trimming", {"share": 1.0}),
    "one concentration step": ("trimming", {"max_iter": 1}),
    "one ridge, 1e-4": ("held_out", {"ridges": (1e-4,)}),
    "ten folds": ("held_out", {"max_folds": 10}),
    "five folds of few demonstrations too": ("held_out", {"max_left_out": 0}),
    "error bars as they are (noise_shares 1)": ("groups", {"noise_shares": (1.0,)}),
    "no prior on the spread of a group": ("groups", {"prior_spread": 1e-6}),
    "no monotony": ("", {"monotony": 0.0}),
    "no second way": (SecondWay, "is_there", property(lambda self: False)),
    "a second way that is strong alone": (SecondWay, "is_there", property(lambda self: self.is_strong)),
    "any credible policy is a second way": (SecondWay, "is_there", property(lambda self: self.is_credible)),
    "few are noise too (no is_learnable)": (inference, "is_learnable", lambda *_: True),
    "own variance of each demonstration (variance_steps 0)": ("", {"variance_steps": 0.0}),
}
COMBINATIONS: dict[str, tuple[str, ...]] = {
    "chance and better half": ("nobody by chance", "no better half"),
    "one dealing of ten folds": ("one dealing of the folds", "ten folds"),
    "no rival groups, no second way": ("no rival groups (max_shared_gain 0)", "no second way"),
}
VARIANTS = {DEFAULT: ()} | COMBINATIONS | {name: (name,) for name in RULES}
ANSWERS: dict[str, AnswerSettings] = {
    DEFAULT: AnswerSettings(),
    "p_agreement .5": AnswerSettings(p_agreement=0.5),
    "p_agreement .99": AnswerSettings(p_agreement=0.99),
    "group_weight 0": AnswerSettings(group_weight=1e-9),
    "group_weight 1": AnswerSettings(group_weight=1.0),
    "sharpness 1": AnswerSettings(sharpness=1.0),
    "sharpness 3": AnswerSettings(sharpness=3.0),
    "no components": AnswerSettings(component_precision=1e6),
    "no wrong answers (error_rates 1e-6)": AnswerSettings(error_rates=(1e-6,)),
    "error_rates .1": AnswerSettings(error_rates=(0.1,)),
}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", default=Path(), help="folder of NPZ files; default: this")
    parser.add_argument("--json", type=output, metavar="OUT", help="where finished variants are kept")
    parser.add_argument("--match", action="append", metavar="NAME", help="only variants whose name begins with it")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="one small world, few variants: checks the script")
    options = parser.parse_args(arguments)
    jobs = [Job("paper", "quick", partial(of_paper, "MountainCar-v0", "corrupted", 0))]
    if not options.quick:
        jobs = jobs_of(options.data)
    origin = provenance(f"0, {DRAWS} draws of labels", asked(parser, options))
    found: Row = {"provenance": origin, "unfinished": True, "rules": {}}
    if options.json and options.json.exists():
        old: Row = json.loads(options.json.read_text(encoding="utf-8"))
        same = all(old["provenance"].get(key) == origin[key] for key in ("commit", "dirty", "arguments"))
        found = old if same else found
    with Pool(options.processes, maxtasksperchild=20) as pool:
        wanted = [name for name in VARIANTS if name.startswith(tuple(options.match or ("",)))]
        for name in [name for name in wanted if name not in found["rules"]][: 3 if options.quick else None]:
            found["rules"][name] = pool.map(partial(audited, name), jobs, chunksize=1)
            if options.json:
                write_json(options.json, found)
        labelled_jobs = [job for job in jobs if job.kind in ("recorded", "paper")]
        audits = pool.map(answers.audited, labelled_jobs, chunksize=1)
    found |= {"answers": {name: labelled(audits, each) for name, each in ANSWERS.items()}, "unfinished": False}
    if options.json:
        write_json(options.json, found)
    print(f"{markdown(found)}\n\n{line(found['provenance'])}")
    return 0


def audited(name: str, job: Job) -> Row:
    """A row of `claims` with some rules changed."""
    judge, before = JudgeSettings(), list[tuple[Any, str, Any]]()
    for change in (RULES[rule] for rule in VARIANTS[name]):
        if len(change) == 2:
            stage, values = change
            judge = replace(judge, **({stage: replace(getattr(judge, stage), **values)} if stage else values))
        else:
            owner, what, function = change
            before.append((owner, what, getattr(owner, what)))
            setattr(owner, what, function)
    try:
        return claims.audited(job, Settings(judge=judge))
    finally:
        for owner, what, function in before:
            setattr(owner, what, function)


def jobs_of(folder: Path) -> list[Job]:
    """Recorded sets, halves of them in which nobody is bad, one draw of each world of a point mass and of each cell of
    the paper, and the kinds of `worlds/kinds.py`."""
    every = (job for job in claims.jobs(folder, 1, 2) if job.kind in FAMILIES)
    return [job for job in every if job.kind != "point mass" or job.name.endswith("12 of 40, 1")]


def labelled(audits: list[Row], settings: AnswerSettings) -> list[Row]:
    """Words for the rest of each set after random labels."""
    rows = []
    for audit in audits:
        for draw in range(DRAWS):
            chosen = answers.drawn(audit["good"], LABELS, np.random.default_rng(draw))
            if chosen is not None:
                rest = answers.rest_of(audit, chosen)
                verdicts = answers.labelled(audit, chosen, settings=replace(settings, max_left_out=0)).verdicts[rest]
                rows.append({"good": audit["good"][rest].tolist(), "verdicts": verdicts.tolist()})
    return rows


def markdown(result: Row) -> str:
    """The section of docs/results.md."""
    text = (
        "Words with other values in `rpil.inference.settings`, or without a rule (benchmarks/ablations.py): right and "
    )
    text += "wrong ones where some are bad, and good demonstrations called outliers. A combination changes several."
    families = [
        family for family in FAMILIES if any(row["kind"] == family for row in next(iter(result["rules"].values())))
    ]
    head = ["| variant | " + " | ".join(families) + " |", "|---|" + "---|" * len(families)]
    rules = [f"| {name} | {' | '.join(cells(rows, families))} |" for name, rows in result["rules"].items()]
    told = [row for name, rows in result["answers"].items() for row in claims.counted(name, rows)]
    named = claims.HEAD[0].replace("kind", "variant").replace("outlier", "called bad")
    named = named.replace("similar", "called good").replace("sets |", "draws |", 1)
    parts = ["## Ablations", "", text, "", *head, *rules, "", f"After {LABELS} random labels, the rest:", ""]
    return "\n".join([*parts, named, claims.HEAD[1], *told])


def cells(rows: list[Row], families: list[str]) -> Iterator[str]:
    """Right and wrong verdicts of each family, and good ones called outliers; the last alone where nobody is bad."""
    for family in families:
        own = [row for row in rows if row["kind"] == family]
        count = claims.counts(own)
        right, wrong, accused = count[-1, 0] + count[1, 1], count[-1, 1] + count[1, 0], count[-1, 1]
        yield f"{accused}" if all(min(row["good"]) > 0 for row in own) else f"{right}, {wrong} ({accused})"


if __name__ == "__main__":
    sys.exit(main())
