"""What each constant of the judge is worth: the words on recorded sets with another value, or without its rule.

    python benchmarks/ablations.py --data ../shared/data --json ablations.json --processes 2
    python benchmarks/ablations.py --quick

First without answers; then after eight random labels, for the constants of answers. A variant is written to the JSON
when it is done, and not done again for the same commit.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
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
from rpil.inference import claims as inference
from rpil.inference.scores import Scoring
from rpil.inference.settings import AnswerSettings, JudgeSettings
from worlds.simulated import of_paper

DEFAULT = "the default"
DRAWS, LABELS = 5, 8


def judge(stage: str, **values: Any) -> Settings:
    """The default with other values in one stage of the judge."""
    every = JudgeSettings()
    return Settings(judge=replace(every, **{stage: replace(getattr(every, stage), **values)}))


RULES: dict[str, Settings | tuple[Any, str, Callable[..., Any]]] = {
    DEFAULT: Settings(),
    "no rival groups (max_shared_gain 0)": judge("rivals", max_shared_gain=0.0),
    "min_p_two .9": judge("claims", min_p_two=0.9),
    "min_p_two .999": judge("claims", min_p_two=0.999),
    "nobody by chance": (inference, "by_chance", lambda *_: None),
    "one dealing of the folds": (Scoring, "dealt_again", lambda *_: None),
    "no better half": (inference, "in_better_part", lambda scores, upper: upper),
    "max_part_share 1": judge("claims", max_part_share=1.0),
    "no order (max_runs_p 0)": judge("claims", max_runs_p=1e-300),
    "no agreement (min_agreement -1)": judge("claims", min_agreement=-1.0),
    "min_proba .95": judge("claims", min_proba=0.95),
    "all teach (share 1)": judge("trimming", share=1.0),
    "share .8": judge("trimming", share=0.8),
    "share .3": judge("trimming", share=0.3),
    "one ridge, 1e-4": judge("held_out", ridges=(1e-4,)),
    "five folds": judge("held_out", max_folds_continuous=5),
    "ten folds": judge("held_out", max_folds_discrete=10, max_folds_continuous=10),
    "error bars as they are (noise_shares 1)": judge("groups", noise_shares=(1.0,)),
    "no prior on the spread of a group": judge("groups", prior_spread=1e-6),
    "two groups may have one centre": judge("groups", min_distance=0.0),
    "no odd experts (tail 0)": judge("groups", tail=1e-12),
    "ranks are worth nothing": judge("groups", rank_correlation=0.0),
    "raw features": Settings(judge_features="raw"),
}
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
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="one small world, few variants: checks the script")
    options = parser.parse_args(arguments)
    jobs = [Job("quick", "", partial(of_paper, "LunarLander-v3", "random", 7))]
    if not options.quick:
        jobs = [job for job in claims.jobs(options.data, 0, 0) if job.kind == "recorded"]
    origin = provenance(f"0, {DRAWS} draws of labels", asked(parser, options))
    found: Row = {"provenance": origin, "unfinished": True, "rules": {}}
    if options.json and options.json.exists():
        old: Row = json.loads(options.json.read_text(encoding="utf-8"))
        same = all(old["provenance"].get(key) == origin[key] for key in ("commit", "dirty", "arguments"))
        found = old if same else found
    with Pool(options.processes, maxtasksperchild=20) as pool:
        for name in [name for name in RULES if name not in found["rules"]][: 3 if options.quick else None]:
            found["rules"][name] = pool.map(partial(audited, name), jobs, chunksize=1)
            if options.json:
                write_json(options.json, found)
        audits = pool.map(answers.audited, jobs, chunksize=1)
    found |= {"answers": {name: labelled(audits, each) for name, each in ANSWERS.items()}, "unfinished": False}
    if options.json:
        write_json(options.json, found)
    print(f"{markdown(found)}\n\n{line(found['provenance'])}")
    return 0


def audited(name: str, job: Job) -> Row:
    """A row of `claims` with one rule changed."""
    rule = RULES[name]
    if isinstance(rule, Settings):
        return claims.audited(job, rule)
    owner, what, function = rule
    before = getattr(owner, what)
    setattr(owner, what, function)
    try:
        return claims.audited(job)
    finally:
        setattr(owner, what, before)


def labelled(audits: list[Row], settings: AnswerSettings) -> list[Row]:
    """Words for the rest of each set after random labels."""
    rows = []
    for audit in audits:
        for draw in range(DRAWS):
            chosen = answers.drawn(audit["good"], LABELS, np.random.default_rng(draw))
            if chosen is not None:
                rest = answers.rest_of(audit, chosen)
                words = answers.labelled(audit, chosen, settings=replace(settings, max_left_out=0)).words[rest]
                rows.append({"good": audit["good"][rest].tolist(), "words": words.tolist()})
    return rows


def markdown(result: Row) -> str:
    """The section of docs/results.md."""
    text = "Words on recorded sets with one constant of `rpil.inference.settings` changed (benchmarks/ablations.py)."
    rules = [row for name, rows in result["rules"].items() for row in claims.counted(name, rows)]
    told = [row for name, rows in result["answers"].items() for row in claims.counted(name, rows)]
    head = [claims.HEAD[0].replace("kind", "variant"), claims.HEAD[1]]
    named = head[0].replace("unlike", "called bad").replace("typical", "called good").replace("sets |", "draws |", 1)
    parts = ["## Ablations", "", text, "", *head, *rules, "", f"After {LABELS} random labels, the rest:", ""]
    return "\n".join([*parts, named, head[1], *told])


if __name__ == "__main__":
    sys.exit(main())
