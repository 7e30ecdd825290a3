"""docs/results.md on one commit: every script whose figures are missing is run, then the page is written.

    python benchmarks/results.py --data ../shared/data --processes 2
    python benchmarks/results.py --data ../shared/data --only claims,answers
    python benchmarks/results.py --quick

Tracked files must be as committed. Figures are kept in a folder, and those of the same commit are not made again, so
that a run that was broken off goes on. At the end the lines of the page that changed are printed. Figures of
policy_value.py take days; where its cells lie in the folder as `value.jsonl`, they get a section.
"""

from __future__ import annotations

import argparse
import difflib
import json
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

import ablations
import answers
import claims
import peers
import policy_value
from options import make_folder
from provenance import line, provenance
from rpil.data.errors import DataError
from rpil.data.files import replacing
from tables import and_list, bullets, by_column
from value.report import report

Result = dict[str, Any]
OURS = "rpil"
ROOT = Path(__file__).parents[1]
HEAD = """# Results

Made by `make results` from the figures that the scripts in `benchmarks/` wrote; edit those, not this. Figures in bold
are the best of their column."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of NPZ files")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "figures", help="where figures are kept")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "results.md", help="the page to write")
    parser.add_argument("--only", default=",".join(SECTIONS), metavar="SCRIPTS", help=f"of {', '.join(SECTIONS)}")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="few small worlds, whatever has changed: checks scripts")
    options = parser.parse_args(arguments)
    names = options.only.split(",")
    if unknown := sorted(set(names) - set(SECTIONS)):
        parser.error(f"there is no script {', '.join(unknown)}: choose from {', '.join(SECTIONS)}.")
    if not (options.data or options.quick):
        parser.error("say where the NPZ files are: --data DIR.")
    try:
        make_folder(options.folder)
        check_clean(options.quick)
        found = {name: figures(name, options) for name in names}
        check_clean(options.quick, {each["provenance"]["commit"] for each in found.values()})
        write(options.page, page(found, policy_value.read(options.folder / "value.jsonl")))
    except DataError as error:
        parser.error(str(error))
    return 0


# ---- figures ---------------------------------------------------------------------------------------------------------


def check_clean(quick: bool, commits: Collection[str] = ()) -> None:
    """Refuse where files are not as committed, or figures are of other `commits`."""
    now = provenance(None)
    if not quick and (now["dirty"] or not now["commit"] or not {now["commit"]}.issuperset(commits)):
        raise DataError("Tracked files differ from the commit; commit them, so that all figures are of one commit.")


def figures(name: str, options: argparse.Namespace) -> Result:
    """What a script wrote on this commit; it is run where nothing finished is there."""
    path = options.folder / f"{name}.json"
    found = finished(path)
    if found is None:
        given = ["--quick"] if options.quick else ["--data", str(options.data)] if name in NEED_DATA else []
        command = [sys.executable, str(ROOT / "benchmarks" / f"{name}.py"), "--json", str(path), *given]
        started = time.perf_counter()
        run = subprocess.run([*command, "--processes", str(options.processes)], stdout=subprocess.DEVNULL, check=False)
        if run.returncode:
            raise DataError(f"{name}.py ended with code {run.returncode}; its message is above. What is done is kept.")
        print(f"{name}.py: {time.perf_counter() - started:.0f} s", file=sys.stderr, flush=True)
        found = read(path)
    return found


def finished(path: Path) -> Result | None:
    """The figures in a file, if they are all there and of this commit."""
    found, now = read(path) if path.exists() else {}, provenance(None)
    origin = found.get("provenance", {})
    same = origin.get("commit") == now["commit"] and not origin.get("dirty") and not now["dirty"]
    return found if origin and same and not found.get("unfinished") else None


def read(path: Path) -> Result:
    try:
        found: Result = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{path.name}: no figures ({type(error).__name__}); remove it and run again.") from None
    return found


# ---- the page --------------------------------------------------------------------------------------------------------


def page(found: dict[str, Result], cells: Sequence[Result]) -> str:
    """The whole page: a section for each script, in the order of `SECTIONS`, and one of driven policies."""
    parts = [HEAD]
    for name, render in SECTIONS.items():
        if name in found:
            parts += [render(found[name]), line(found[name]["provenance"])]
    if cells:
        parts += [f"## Policies\n\n`benchmarks/policy_value.py`, {len(cells)} cells.", report(cells)]
    return "\n\n".join(parts) + "\n"


def write(path: Path, text: str) -> None:
    """Write the page, and print the lines that changed."""
    old = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    changed = list(difflib.unified_diff(old, text.splitlines(), n=0, lineterm=""))[2:]
    print("\n".join(row for row in changed if not row.startswith("@@")) or "Nothing changed.")


# ---- the paper -----------------------------------------------------------------------------------------------------

NOT_LEARNED = ("expert", "raw oracle", "oracle")
"""Policies that know the truth, or that are not fitted: they are not compared with the others."""


def paper(result: Result) -> str:
    """Tables 1-6: every policy over draws, then the paper's way of measuring beside what it prints."""
    tables = result["tables"]
    names = [f"{of['table']}. {of['env'].split('-')[0]} {of['kind']}" for of in tables]
    policies = list(dict.fromkeys(name for of in tables for name in of["policies"]))

    def cells(name: str, value: str | None) -> list[tuple[str, float | None]]:
        found = [of["policies"].get(name) for of in tables]
        found = [row if row is None or value is None else row[value] for row in found]
        plays = name not in NOT_LEARNED
        return [("–", None) if row is None else (plus_minus(row), row["mean"] if plays else None) for row in found]

    printed = {
        f"{name}, printed": [
            (f"{of['policies'].get(name, {}).get('printed', float('nan')):.2f}", None) for of in tables
        ]
        for name in policies
        if any("printed" in of["policies"].get(name, {}) for of in tables)
    }
    draws = and_list(sorted({str(of["draws"]) for of in tables}))
    verdicts = [
        f"Wrong verdicts of {name}: "
        + and_list(
            [f"{of['policies'][name]['wrong']} of {of['verdicts']} in table {of['table']}" for of in with_verdicts]
        )
        + "."
        for name in policies
        if (with_verdicts := [of for of in tables if "wrong" in of["policies"].get(name, {})])
    ]
    return "\n\n".join(
        [
            "## The paper's tables",
            f"`benchmarks/paper.py`: 10 good and 10 bad demonstrations, {draws} draws of the data, "
            f"{result['rollouts']} rollouts a policy, features `{result['features']}` where no others are named. Mean "
            "return ± half the 95 % interval over draws; the best of each column is bold, experts and oracles aside.",
            by_column(names, {name: cells(name, None) for name in policies}, digits=1),
            bullets([*behind_in_paper(tables), *verdicts]),
            "The same the paper's way: 20 rollouts of one policy from one draw, ± half the 95 % interval over "
            "rollouts. *Printed* is what the paper has.",
            by_column(names, printed | {name: cells(name, "paper_way") for name in policies}, digits=1),
        ]
    )


def plus_minus(of: Result, digits: int = 1) -> str:
    return f"{of['mean']:.{digits}f} ± {of['half_width']:.{digits}f}"


def behind_in_paper(tables: Iterable[Result]) -> list[str]:
    """Methods above ours over draws, and tables in which the paper prints more."""
    lines = []
    for of in tables:
        policies = of["policies"]
        ours = policies[OURS]
        above = {name: row for name, row in policies.items() if name != "expert" and row["mean"] > ours["mean"]}
        better = [f"{name} {plus_minus(row)}" for name, row in sorted(above.items(), key=lambda of: -of[1]["mean"])]
        better += [
            f"the paper's print of {name} {row['printed']:.2f}"
            for name, row in policies.items()
            if row.get("printed", ours["mean"]) > ours["mean"]
        ]
        if better:
            where = f"Table {of['table']}, {of['env']} {of['kind']}"
            lines.append(f"{where}: above ours ({plus_minus(ours)}): {and_list(better)}.")
    return lines or ["No method is above ours in any table, the oracles included."]


SECTIONS: dict[str, Callable[[Result], str]] = {
    "claims": claims.markdown,
    "answers": answers.markdown,
    "peers": peers.markdown,
    "ablations": ablations.markdown,
    "paper": paper,
}
NEED_DATA = ("claims", "answers", "peers", "ablations")

if __name__ == "__main__":
    sys.stdout.reconfigure(encoding="utf-8")  # type: ignore[union-attr]
    raise SystemExit(main())
