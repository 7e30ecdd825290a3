"""Runs cells of a world, one JSON file for each cell and seed; columns that a file has are not run again."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import rpil

from .columns import COLUMNS, Deed, auroc
from .ours import Case
from .peers import NotMadeForIt

if TYPE_CHECKING:
    from .world import Made, World

Row = dict[str, Any]


def run(
    world: World, cells: Iterable[str], seeds: Iterable[int], folder: Path, columns: Iterable[str], quick: bool
) -> None:
    """Run what the folder does not have yet. Each file is whole at any time, and grows by a column."""
    folder.mkdir(parents=True, exist_ok=True)
    columns, now = list(columns), commit()
    for seed in seeds:
        for cell in cells:
            path = folder / f"{slug(world.name)}_{slug(cell)}_{seed}.json"
            found = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
            if found.get("commit", now) != now:
                raise SystemExit(f"{path}: it is of commit {found['commit']}, not of {now}; give another folder.")
            if found.get("quick", quick) != quick:
                raise SystemExit(f"{path}: it was run {'without' if quick else 'with'} --quick; give another folder.")
            missing = [name for name in columns if name not in found.get("columns", {})]
            if missing:
                fill(path, found, world, cell, seed, missing, quick)


def fill(path: Path, found: Row, world: World, cell: str, seed: int, missing: list[str], quick: bool) -> None:
    """Run the `missing` columns of one draw."""
    made = world.make(cell, seed, quick)
    case, driven, M = Case(made, seed), dict[str, float](), len(made.demonstrations)
    about = {"world": world.name, "cell": cell, "seed": seed, "quick": quick, "source": world.source}
    about |= {"licence": world.licence, "published": world.published, "rpil": rpil.__version__, "commit": commit()}
    about["whole"] = getattr(world, "whole", 100.0)  # what counts as 100 points
    found = about | {"demonstrations": M, "good": int(made.good.sum()), "columns": {}} | found
    for name in missing:
        found["columns"][name] = row = measured(name, case, world, cell, quick, driven)
        temporary = path.with_suffix(".tmp")
        temporary.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        os.replace(temporary, path)
        print(world.name, cell, seed, name, row, file=sys.stderr, flush=True)


def measured(name: str, case: Case, world: World, cell: str, quick: bool, driven: dict[str, float]) -> Row:
    """AUROC, policy and CPU seconds of a column, or why it has none."""
    own = name.startswith("rpil ")
    if own:
        _ = case.audit  # its seconds count once for each column that reads it
    begin = time.process_time()
    try:
        deed = COLUMNS[name](case)
    except NotMadeForIt as reason:
        return {"auroc": None, "policy": None, "seconds": None, "why": str(reason)}
    seconds = time.process_time() - begin + (case.seconds if own else 0.0)
    return {"auroc": auroc(deed, case), "policy": drive(deed, case, world, cell, quick, driven), "seconds": seconds}


def drive(deed: Deed, case: Case, world: World, cell: str, quick: bool, driven: dict[str, float]) -> float | None:
    """What the world's learner reaches; None where the world drives none. What was driven already is not again."""
    weights = np.asarray(deed.weights, dtype=float)
    if weights.shape != (case.data.n_steps,) or not np.isfinite(weights).all() or (weights < 0).any():
        raise ValueError(f"{world.name} {cell}: weights must be {case.data.n_steps} finite numbers, none below 0.")
    weights = np.round(weights / weights.max(), 9) if weights.any() else np.ones(len(weights))
    made: Made = case.made if deed.corrected is None else replace(case.made, demonstrations=deed.corrected)
    digest = hashlib.sha256(weights.tobytes() + np.ascontiguousarray(made.demonstrations.actions).tobytes()).hexdigest()
    if digest not in driven:
        driven[digest] = float(world.drive(cell, made, weights, case.seed, quick))
    return driven[digest] if np.isfinite(driven[digest]) else None


def slug(text: str) -> str:
    return re.sub(r"[^a-z0-9.]+", "-", text.lower()).strip("-")


def commit() -> str | None:
    """The commit of the checkout that this package lies in, with a plus where files differ from it."""
    command = [
        "git",
        "-C",
        str(Path(__file__).parent),
        "describe",
        "--always",
        "--exclude=*",
        "--abbrev=12",
        "--dirty=+",
    ]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None
