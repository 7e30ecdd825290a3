"""Rankings, verdicts and findings of the judge on recorded and generated data, against peers.

    python benchmarks/trust.py --data DIR --json trust.json --processes 2      # what is finished is not done again
    python benchmarks/trust.py --quick

DIR holds NPZ files, see trust_data.py; the worlds of trust_worlds.py are always judged. Ours is `rpil.RPIL()` with all
of its defaults. It is compared with the peers of trust_peers.py, on generated worlds with the best of them alone.
Every method is given observations, actions and which steps belong together; all truth is for scoring.

Where the data cannot tell which group is good, ours is fitted once more with labels, which are not scored: flipped and
shifted simulated demonstrations with one of each sort, and styles that differ by more than 10 nats a demonstration with
one label on a demonstration that the audit asks for.

Printed are tables for every family, and the goals. The JSON keeps every answer with a digest of the code it came from;
an answer from other code is replaced. The exit status is 0 where every goal is met.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
import warnings
from collections.abc import Iterable
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy; worker processes inherit it

import numpy as np

import rpil
from options import at_least, output
from provenance import provenance
from rpil.audit.record import Audit
from rpil.data.demonstrations import SOURCE
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.estimators.rpil import RPIL
from rpil.numerics.parallel import in_processes
from scoring import plain_words
from trust_data import data_cells
from trust_goals import goals
from trust_peers import SINGLE
from trust_report import markdown
from trust_scores import OURS, measured
from trust_worlds import FAMILIES, Cell, World, cells

METHODS = (OURS, *SINGLE)
ON_GENERATED = (OURS, "trimmed")
QUICK = (
    "simulated MountainCar-v0 corrupted 50 % 1000",
    "simulated MountainCar-v0 flip 50 % 1000",
    "simulated Pendulum-v1 noisy 50 % 1000",
    "styles 10 % 70:30 200 steps 6 discrete 0",
    "nothing shuffled actions discrete 0",
    "well-specified 20 x 10 uniform 0",
)
PEER_PARTS = ("numerics", "policies", "mixture")
"""Packages of the library that peers are made of; a change elsewhere does not concern them."""

HERE, LIBRARY = Path(__file__).parent, Path(rpil.__file__).parent

ASK_ABOVE = 10.0
"""Nats a demonstration from which styles ought to be told apart."""

Row = dict[str, Any]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="where NPZ files are; default: generated worlds alone")
    parser.add_argument("--worlds", action="append", metavar="NAME", help="world or family, may hold *; repeatable")
    parser.add_argument("--methods", action="append", metavar="NAME", help=f"of {', '.join(METHODS)}; repeatable")
    parser.add_argument("--processes", type=at_least(1), default=1)
    parser.add_argument("--quick", action="store_true", help="a handful of small worlds")
    parser.add_argument("--json", type=output, metavar="FILE", help="where answers are kept and figures are written")
    options = parser.parse_args(arguments)
    for name in options.methods or ():
        if name not in METHODS:
            parser.error(f"there is no method {name!r}; choose from {', '.join(METHODS)}.")
    try:
        found, skipped = data_cells(options.data) if options.data else ({}, [])
        chosen = wanted(found | cells(), [*(options.worlds or []), *(QUICK if options.quick else [])])
        results = Results(options.json)
    except DataError as error:
        parser.error(str(error))
    for sentence in skipped:
        print(sentence, file=sys.stderr)
    work(jobs(chosen, options.methods), results, options.processes)
    result = results.report(chosen) | {"skipped": skipped}
    results.write(result)
    print(markdown(result))
    return 0 if all(goal["met"] for goal in result["goals"]) else 1


def wanted(every: dict[str, Cell], patterns: list[str]) -> list[Cell]:
    """The worlds whose name or family fits one of the patterns; all where there is no pattern."""
    for pattern in patterns:
        if not any(fits(cell, pattern) for cell in every.values()):
            raise DataError(f"no world and no family is called {pattern!r}; families made here: {', '.join(FAMILIES)}.")
    return [cell for cell in every.values() if not patterns or any(fits(cell, pattern) for pattern in patterns)]


def fits(cell: Cell, pattern: str) -> bool:
    return fnmatchcase(cell.name, pattern) or fnmatchcase(cell.family, pattern)


def jobs(chosen: Iterable[Cell], methods: list[str] | None) -> list[tuple[Cell, str]]:
    """What has to be done in all; generated worlds meet few methods unless some are named."""
    return [
        (cell, method)
        for cell in chosen
        for method in methods or (ON_GENERATED if cell.family in FAMILIES else METHODS)
    ]


# ---- one job ---------------------------------------------------------------------------------------------------------


def answer(cell: Cell, method: str) -> tuple[Row, Row]:
    """The truth about a world and the answer of a method, or its error."""
    world = cell.make()
    row: Row = {"set": cell.name, "method": method}
    begun = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # ambiguity and convergence: the figures show the consequence
            found = ours(world) if method == OURS else peer(world, method)
    except DataError as error:
        found = {"said": str(error).removeprefix(f"{world.name}: ").removeprefix(f"{SOURCE}: ")}
    except Exception as error:  # whatever it is, it is written down and the others go on
        found = {"error": f"{type(error).__name__}: {error}"}
    return truth_of(world), row | {"seconds": time.process_time() - begun} | found


def peer(world: World, method: str) -> Row:
    scores = SINGLE[method](world.observations, world.actions, world.episode_ids)
    if not np.isfinite(scores).all():
        return {"error": "a score is missing or infinite"}
    return {"scores": plain(scores)}


def ours(world: World) -> Row:
    """The default, and where labels are needed the same with them."""
    data, begun = world.demonstrations, time.process_time()
    audit = RPIL().fit(data).audit_
    found = described(audit) | {"seconds": time.process_time() - begun}
    labels = labels_for(world, audit)
    if labels:
        answers = described(RPIL().fit(data, labels=labels).audit_)
        found["labelled"] = answers | {"labels": {str(m): label for m, label in labels.items()}}
    return found


def described(audit: Audit) -> Row:
    """An audit as plain numbers; the index of a demonstration is its id."""
    evidence = getattr(audit, "evidence", None) or {"actions": audit.log_odds}
    finding = getattr(audit, "finding", None) or ("some are unlike" if audit.identifiable else "two groups")
    return {
        "scores": plain(audit.log_odds),
        "length": plain(evidence.get("length", np.zeros(len(audit.ids)))),
        "expert_proba": plain(audit.expert_proba),
        "verdicts": plain_words(audit.verdicts),
        "finding": str(finding),
        "groups": [[int(m) for m in group] for group in audit.competing],
    }


def labels_for(world: World, audit: Audit) -> dict[int, str]:
    """The labels that a person with the truth would give, where the audit cannot know."""
    if world.extra.get("unknowable"):
        good, bad = (int(np.flatnonzero(world.is_good == kind)[0]) for kind in (1, 0))
        return {good: "good", bad: "bad"}
    if "style" in world.extra and world.extra["log_ratio"].mean() > ASK_ABOVE:
        style = world.extra["style"]
        asked = (*audit.pair, int(np.flatnonzero(style == 0)[0]), int(np.flatnonzero(style == 1)[0]))
        return {int(m): "bad" if style[m] == 1 else "good" for m in asked}
    return {}


def truth_of(world: World) -> Row:
    return {
        "family": world.family,
        "steps": len(world.actions),
        "lengths": np.bincount(world.episode_ids).tolist(),
        "is_good": world.is_good.tolist(),
        "quality": None if world.quality is None else plain(world.quality),
        "extra": {key: plain(value) if isinstance(value, np.ndarray) else value for key, value in world.extra.items()},
    }


def plain(values: Any) -> list[float]:
    """Numbers with the seven digits that a JSON needs."""
    return [float(f"{value:.7g}") for value in np.asarray(values, dtype=float)]


# ---- many jobs, and what is already there ----------------------------------------------------------------------------


class Results:
    """Truth about worlds and answers of methods, kept in a JSON file that is replaced as a whole after each answer."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.worlds: dict[str, Row] = {}
        self.rows: dict[tuple[str, str], Row] = {}
        if path and path.exists():
            try:
                held = json.loads(path.read_text(encoding="utf-8"))
                self.worlds = dict(held["worlds"])
                self.rows = {(row["set"], row["method"]): row for row in held["rows"]}
            except (ValueError, KeyError, TypeError):
                raise DataError(f"{path.name}: it holds no results of this script; give another file.") from None

    def has(self, cell: Cell, method: str) -> bool:
        """Whether a method has answered, with the code and the data of today; what failed is tried again."""
        return self.current(cell, method) and "error" not in self.rows[cell.name, method]

    def current(self, cell: Cell, method: str) -> bool:
        """Whether there is an answer, or a failure, of that kind."""
        row = self.rows.get((cell.name, method), {})
        return row.get("made_by") == made_by(cell, method) and cell.name in self.worlds

    def add(self, cell: Cell, truth: Row, row: Row) -> None:
        self.worlds[cell.name] = truth
        self.rows[cell.name, row["method"]] = row | {"made_by": made_by(cell, row["method"])}
        self.write({})

    def write(self, more: Row) -> None:
        if self.path:
            found = more | {"worlds": self.worlds, "rows": list(self.rows.values())}
            with replacing(self.path) as temporary:  # in one line: thousands of numbers, written after each answer
                temporary.write_text(json.dumps(found, allow_nan=False) + "\n", encoding="utf-8")

    def report(self, chosen: Iterable[Cell]) -> Row:
        """All figures of some worlds, and the goals."""
        sets = []
        for cell in chosen:
            rows = {method: self.rows[cell.name, method] for method in METHODS if self.current(cell, method)}
            if rows:
                sets.append(measured(cell.name, self.worlds[cell.name], rows))
        return {"provenance": provenance("in the names of worlds"), "sets": sets, "goals": goals(sets)}


def made_by(cell: Cell, method: str) -> dict[str, str]:
    """Digests of all that an answer depends on: the library or a peer's code, and the file or the worlds' code."""
    files = tuple(argument for argument in cell.arguments if isinstance(argument, Path))
    return {"code": digest(code_of(method == OURS)), "data": digest(files or code_of_worlds())}


@cache
def digest(paths: tuple[Path, ...]) -> str:
    """Of the bytes of files, read once: what is running is the code that was there at the start."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:12]


@cache
def code_of(our_method: bool) -> tuple[Path, ...]:
    """The files of the library, or those of them that peers are made of and the peers'."""
    every = tuple(sorted(LIBRARY.rglob("*.py")))
    if our_method:
        return every
    parts = (path for path in every if path.relative_to(LIBRARY).parts[0] in PEER_PARTS)
    return (*parts, *sorted(HERE.glob("peers*.py")), HERE / "trust_peers.py")


@cache
def code_of_worlds() -> tuple[Path, ...]:
    return (
        HERE / "grid.py",
        HERE / "trust_worlds.py",
        HERE / "trust_operators.py",
        *sorted((LIBRARY / "simulation").glob("*.py")),
    )


def work(every: list[tuple[Cell, str]], results: Results, processes: int) -> None:
    """Do the missing jobs, with progress on stderr."""
    todo = [job for job in every if not results.has(*job)]
    begun = time.perf_counter()
    answers = in_processes(answer, todo, processes)
    for done, ((cell, method), (truth, row)) in enumerate(zip(todo, answers, strict=True), 1):
        results.add(cell, truth, row)
        far = f"{done} of {len(todo)}, {time.perf_counter() - begun:.0f} s"
        said = row.get("error") or row.get("said") or f"{row['seconds']:.1f} s"
        print(f"{far}: {cell.name}, {method}: {said}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
