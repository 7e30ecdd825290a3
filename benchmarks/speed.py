"""How fast, as ratios: scikit-learn, bare matrix products and bare loops beside, thread counts equal.

    python benchmarks/speed.py --json speed.json
    python benchmarks/speed.py --rows A,D --repeats 1
    python benchmarks/speed.py --rows K,L,M,N --data ../shared/data
    python benchmarks/speed.py --data ../shared/data --json speed.json --page docs/speed.md
    python benchmarks/speed.py --quick                   # small sizes: checks the harness, not the time

Every row is one function of `speed_fits`, `speed_systems` or `speed_audits`, which says what it measures.
Rows A to D have one core and one thread, also for scikit-learn; E and G have all cores. The seconds are
medians over runs that take turns; those of rows K to R and W are CPU seconds. Rows that the JSON has of the same clean
commit are not measured again; `--page` writes the table where all rows are of one.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

# Before NumPy; other processes inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import speed_audits
import speed_fits
import speed_shares
import speed_systems
from options import output, write_json
from provenance import line, provenance
from speed_common import Measured, Skipped, peak_gib, threads

HEAD = """# How fast

`make results` writes this page with `python benchmarks/speed.py`; edit the script, not the page. Its functions say what
each row measures. All rows come from one commit. A ratio comes from one run in which both sides take turns. Rows that
end in `_cpu` are seconds of CPU. A figure in bold misses its goal."""
WHERE = """## Where the time goes

Shares of the CPU of one more run. *Arithmetic* is that of fits; *judging* decides on fits; *rules* look for recording
faults."""
MOST_GIB = 16.0
MOST_CROSS_FITS = 12.0
"""Times a cross-fit that the fit of recorded data with continuous actions may take."""


@dataclass(frozen=True)
class Row:
    """A row of the table: what is measured how, on how much, and what its numbers should be at most."""

    what: str
    measure: Callable[[dict[str, int], int], Measured | Skipped]
    full: dict[str, int]
    quick: dict[str, int]
    goals: dict[str, float | None]


def recorded(letter: str, what: str, file: str, seconds: float) -> Row:
    """A row on recorded data, of which there is one size; `ROWS` get the folder as `DATA`."""

    def measure(_: dict[str, int], repeats: int) -> Measured | Skipped:
        return speed_audits.default_fit(letter, None if DATA.folder is None else DATA.folder / file, repeats)

    return Row(what, measure, {}, {}, {letter: seconds, f"{letter}_ratio": MOST_CROSS_FITS if letter != "N" else 0.5})


@dataclass
class Data:
    """Where recorded data are, if anywhere."""

    folder: Path | None = None


DATA = Data()
_LARGE = {"steps": 1_000_000, "features": 64, "actions": 6}
_SMALL = {"steps": 2_000, "features": 4, "actions": 3}
ROWS = {
    "A": Row("RPIL over LogisticRegression", speed_fits.plain, _LARGE, _SMALL, {"A": 0.45}),
    "B": Row(
        "the same on features of Nystroem; over newton-cg",
        speed_fits.ill_conditioned,
        {"demonstrations": 200},
        {"demonstrations": 2},
        {"B": 0.6, "B_newton_cg": 1.0},
    ),
    "D": Row("a pass over two matrix products", speed_fits.one_pass, _LARGE, _SMALL, {"D": 2.0}),
    "E": Row(
        "from disk: GiB, and time over in memory",
        speed_systems.from_disk,
        {"steps": 20_000_000, "subset": 2_000_000, "features": 32, "actions": 4},
        {"steps": 20_000, "subset": 15_000, "features": 4, "actions": 3},
        {"E_rss_gib": 0.5, "E_time": 1.1},
    ),
    "G": Row(
        "Dask, two processes, over in memory",
        speed_systems.cluster,
        {"steps": 10_000_000, "features": 32, "actions": 4},
        {"steps": 20_000, "features": 4, "actions": 3},
        {"G": 1.15},
    ),
    "J": Row(
        "import rpil over import numpy; rpil --help",
        speed_systems.start_up,
        {"starts": 15},
        {"starts": 1},
        {"J": 1.3, "J_help_s": 0.3},
    ),
    "K": recorded("K", "RPIL() on LeRobot, 50 files: CPU s, over a cross-fit", "formats/lerobot_v3_50files", 10.0),
    "L": recorded("L", "RPIL() on MetaWorld push", "metaworld_push.npz", 3.0),
    "M": recorded("M", "RPIL() on Ant, mixed agents", "rilco_ant_mix.npz", 10.0),
    "N": recorded("N", "RPIL() on Overcooked, coordination ring", "overcooked_coordination_ring.npz", 3.0),
    "O": Row(
        "RPIL() on 253 columns: CPU s",
        speed_audits.wide_fit,
        {"steps": 2_236, "features": 253, "actions": 7, "demonstrations": 20},
        {"steps": 400, "features": 10, "actions": 2, "demonstrations": 8},
        {"O": 1.0},
    ),
    "P": Row(
        "rpil audit, check of a LeRobot folder: CPU s, over reading",
        partial(speed_audits.audit_of_folder, "PR"),
        {"episodes": 2_000, "steps": 500, "joints": 14},
        {"episodes": 12, "steps": 60, "joints": 3},
        {"P_cpu": 6.0, "P": 3.0, "R_cpu": 2.0, "R": 3.0},
    ),
    "S": Row(
        "the same of 20 episodes",
        partial(speed_audits.audit_of_folder, "ST"),
        {"episodes": 20, "steps": 500, "joints": 14},
        {"episodes": 6, "steps": 60, "joints": 3},
        {"S_cpu": 1.0, "T_cpu": 0.6},
    ),
    "W": Row(
        "rpil.audit: 300 useless columns, numbers and classes; 100 classes",
        speed_audits.wide_audits,
        {"demonstrations": 60, "useless": 300, "classes": 100},
        {"demonstrations": 12, "useless": 3, "classes": 4},
        {"W_numbers": 1.0, "W_classes": 1.5, "W_many": 2.0},
    ),
    "Q": Row(
        "rpil audit of a small file: CPU s, over imports; info",
        speed_audits.start,
        {"demonstrations": 49, "steps": 112, "columns": 39, "actions": 6},
        {"demonstrations": 8, "steps": 20, "columns": 4, "actions": 2},
        {"Q": 1.0, "Q_ratio": 8.0, "Q_info": 0.5},
    ),
}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", default=",".join(ROWS), help="letters, with commas; all by default")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each, of which the median counts")
    parser.add_argument("--quick", action="store_true", help="small sizes, once: checks the harness, not the time")
    parser.add_argument("--data", type=Path, help="a folder of recorded data, for rows K to N")
    parser.add_argument("--json", type=output, metavar="OUT", help="where rows are kept once they are measured")
    parser.add_argument("--page", type=output, metavar="OUT", help="also write the table as a page of docs")
    options = parser.parse_args(arguments)
    letters = options.rows.upper().split(",")
    unknown = sorted(set(letters) - set(ROWS))
    if unknown:
        parser.error(f"there is no row {', '.join(unknown)}: choose from {', '.join(ROWS)}")

    DATA.folder = options.data
    repeats = 1 if options.quick else options.repeats
    result: dict[str, Any] = {"quick": options.quick, "repeats": repeats, "threads": threads(), "details": {}}
    result |= {"rows": [], "provenance": provenance(seeds=0)}
    result = kept(options.json, result) if options.json else result
    print(f"threads of every pool: {result['threads']}")
    for letter in (letter for letter in letters if letter not in result["rows"]):
        print(f"{letter}: {ROWS[letter].what}", file=sys.stderr, flush=True)
        result |= measured(letter, options.quick, repeats, result["details"])
        result["rows"] += [letter] if "skipped" not in result["details"][letter] else []
        result["peak_gib"] = peak_gib()
        if options.json:
            write_json(options.json, result)
    print(table(result, letters))
    if options.page:
        options.page.write_text(page(result), encoding="utf-8")
    return 0


def kept(path: Path, now: dict[str, Any]) -> dict[str, Any]:
    """The rows in a file, where they are of the same clean commit and sizes, or `now`."""
    found = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    origin, present = found.get("provenance", {}), now["provenance"]
    same = origin.get("commit") == present["commit"] and not origin.get("dirty") and not present["dirty"]
    return found if same and found["quick"] == now["quick"] else now


def page(result: dict[str, Any]) -> str:
    """docs/speed.md: all rows with their goals, and the commit of those that were measured."""
    lines = [HEAD, "", "| row | what | found | goal |", "|---|---|---|---|"]
    for letter, row in ROWS.items():
        for key, goal in row.goals.items():
            found = f"{result[key]:.4g}" if letter in result["rows"] else "not measured"
            found = f"**{found}**" if letter in result["rows"] and goal is not None and float(found) > goal else found
            lines.append(f"| {key} | {row.what} | {found} | {'' if goal is None else f'{goal:g}'} |")
    where = [WHERE, "", *speed_shares.table(result["details"])]
    return "\n".join([*lines, "", *where, "", line(result["provenance"]), ""])


def measured(letter: str, quick: bool, repeats: int, details: dict[str, Any]) -> dict[str, float]:
    """The numbers of one row; what explains them goes to `details`."""
    row, begun = ROWS[letter], time.perf_counter()
    size = row.quick if quick else row.full
    found = row.measure(size, repeats)
    took = {"size": size, "took_s": time.perf_counter() - begun}
    if isinstance(found, Skipped):
        details[letter] = took | {"skipped": found.why}
        return {}
    details[letter] = took | found.details
    return found.values


def table(result: dict[str, Any], letters: list[str]) -> str:
    """Every number beside its goal, for a terminal."""
    lines = [f"{'row':12}{'what':54}{'found':>9}{'goal':>10}"]
    for letter in letters:
        for key, goal in ROWS[letter].goals.items():
            aim = "" if goal is None else f"<= {goal:.3g}"
            if goal is None and key in result:
                lines.append(f"{key:12}{ROWS[letter].what:54}{result[key]:9.3g}")
            elif key in result:
                verdict = "reached" if result[key] <= goal else "missed"
                lines.append(f"{key:12}{ROWS[letter].what:54}{result[key]:9.3g}{aim:>10}  {verdict}")
            else:
                why = result["details"][letter]["skipped"]
                lines.append(f"{key:12}{ROWS[letter].what:54}{'':9}{aim:>10}  skipped: {why}")
    memory = "below" if result["peak_gib"] < MOST_GIB else "above"
    if result["quick"]:
        lines.append("Small sizes: these numbers say that everything runs, and nothing about its speed.")
    lines.append(f"peak memory {result['peak_gib']:.2f} GiB, {memory} {MOST_GIB:g}")
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
