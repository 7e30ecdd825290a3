"""docs/results.md on one commit: every script whose figures are missing is run, then the page is written.

    python benchmarks/results.py --data ../shared/data --processes 2
    python benchmarks/results.py --data ../shared/data --only claims,answers
    python benchmarks/results.py --quick

Tracked files must be as committed. Figures are kept in a folder, and those of the same commit are not made again, so
that a run that was broken off goes on; with `--only` other sections are of figures that are there. At the end the lines
of the page that changed are printed. Figures of policy_value.py take days; where its cells lie in the folder as
`value.jsonl`, or as `value TITLE.jsonl`, each file is a section. With `--quick` the page is printed, and figures are
kept in a folder of their own.
"""

from __future__ import annotations

import argparse
import difflib
import json
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import ablations
import answers
import claims
import paper
import peers
import policy_value
from options import make_folder
from provenance import line, provenance
from rpil.data.errors import DataError
from rpil.data.files import replacing
from value.report import report

Result = dict[str, Any]
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
    if options.quick:
        options.folder = options.folder / "quick"
    try:
        make_folder(options.folder)
        check_clean(options.quick)
        found = {name: figures(name, options, run=name in names) for name in SECTIONS}
        found = {name: each for name, each in found.items() if each}
        check_clean(options.quick, {each["provenance"]["commit"] for each in found.values()})
        text = page(found, sorted(options.folder.glob("value*.jsonl"), key=lambda path: path.stem))
        if options.quick:
            print(text)
        else:
            write(options.page, text)
    except DataError as error:
        parser.error(str(error))
    return 0


# ---- figures ---------------------------------------------------------------------------------------------------------


def check_clean(quick: bool, commits: Collection[str] = ()) -> None:
    """Refuse where files are not as committed, or figures are of other `commits`."""
    now = provenance(None)
    if not quick and (now["dirty"] or not now["commit"] or not {now["commit"]}.issuperset(commits)):
        raise DataError("Tracked files differ from the commit; commit them, so that all figures are of one commit.")


def figures(name: str, options: argparse.Namespace, *, run: bool) -> Result | None:
    """What a script wrote on this commit; where nothing finished is there, it is run, or None without `run`."""
    path = options.folder / f"{name}.json"
    found = finished(path, options.quick)
    if found is None and run:
        given = ["--quick"] if options.quick else ["--data", str(options.data)] if name in NEED_DATA else []
        command = [sys.executable, str(ROOT / "benchmarks" / f"{name}.py"), "--json", str(path), *given]
        started = time.perf_counter()
        ended = subprocess.run(
            [*command, "--processes", str(options.processes)], stdout=subprocess.DEVNULL, check=False
        )
        if ended.returncode:
            raise DataError(
                f"{name}.py ended with code {ended.returncode}; its message is above. What is done is kept."
            )
        print(f"{name}.py: {time.perf_counter() - started:.0f} s", file=sys.stderr, flush=True)
        found = read(path)
    return found


def finished(path: Path, quick: bool) -> Result | None:
    """The figures in a file, if they are all there, of this commit, and of a whole run, or of a quick one."""
    found, now = read(path) if path.exists() else {}, provenance(None)
    origin = found.get("provenance", {})
    same = origin.get("commit") == now["commit"] and not origin.get("dirty") and not now["dirty"]
    same = same and origin.get("arguments") == ({"quick": True} if quick else {})
    return found if same and not found.get("unfinished") else None


def read(path: Path) -> Result:
    try:
        found: Result = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{path.name}: no figures ({type(error).__name__}); remove it and run again.") from None
    return found


# ---- the page --------------------------------------------------------------------------------------------------------


def page(found: dict[str, Result], driven: Sequence[Path]) -> str:
    """The whole page: a section for each script, in the order of `SECTIONS`, and one for each file of cells."""
    parts = [HEAD]
    for name, render in SECTIONS.items():
        if name in found:
            parts += [render(found[name]), line(found[name]["provenance"])]
    for path in driven:
        cells, title = policy_value.read(path), path.stem.replace("value", "Policies", 1)
        parts += [f"## {title}\n\n`benchmarks/policy_value.py`, {len(cells)} cells.", report(cells)]
    return "\n\n".join(parts) + "\n"


def write(path: Path, text: str) -> None:
    """Write the page, and print the lines that changed."""
    old = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    changed = list(difflib.unified_diff(old, text.splitlines(), n=0, lineterm=""))[2:]
    print("\n".join(row for row in changed if not row.startswith("@@")) or "Nothing changed.")


SECTIONS: dict[str, Callable[[Result], str]] = {
    "claims": claims.markdown,
    "answers": answers.markdown,
    "peers": peers.markdown,
    "ablations": ablations.markdown,
    "paper": paper.markdown,
}
NEED_DATA = ("claims", "answers", "peers", "ablations")

if __name__ == "__main__":
    sys.stdout.reconfigure(encoding="utf-8")  # type: ignore[union-attr]
    raise SystemExit(main())
