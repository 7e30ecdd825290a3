"""docs/results.md from what the other scripts wrote: figures, where they come from, and where ours are not the best.

    python benchmarks/results.py --acceptance acceptance.json --paper paper.json --features features.json \\
        --robustness robustness/summary.json --robustness-continuous continuous/summary.json \\
        --real real.json --real-continuous real_continuous.json \\
        --demonstrators demonstrators.json > docs/results.md

Every file is optional; a section comes for each that is given. Nothing here is written by hand but the words around the
numbers.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import real_report
from provenance import line
from rpil.data.errors import DataError
from tables import and_list, bold_best, bullets, by_column, table

Result = dict[str, Any]
OURS = "rpil"
HEAD = """# Results

Made by `python benchmarks/results.py` from the figures that the scripts in `benchmarks/` wrote; edit those, not this.
Under every table stands where ours is not the best or a goal is missed."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in SECTIONS:
        option = f"--{name.replace('_', '-')}"
        parser.add_argument(option, type=Path, metavar="JSON", help=f"what {script(name)} wrote")
    options = vars(parser.parse_args(arguments))
    try:
        print(results({name: read(path) for name, path in options.items() if path}), end="")
    except DataError as error:
        parser.error(str(error))
    return 0


def read(path: Path) -> Result:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{path.name}: no figures ({type(error).__name__}); run its script again.") from None


def results(found: dict[str, Result]) -> str:
    """The whole page: a section for each script that has figures, in the order of `SECTIONS`."""
    if not found:
        raise DataError(f"No figures were given; give one of --{', --'.join(SECTIONS).replace('_', '-')} at least.")
    parts = [HEAD]
    for name, render in SECTIONS.items():
        if name in found:
            try:
                parts.append(render(found[name]))
            except KeyError as error:
                said = f"The figures of {script(name)} have no {error}; run {script(name)} of this version."
                raise DataError(said) from None
            parts.append(origin(found[name]))
    return "\n\n".join(parts) + "\n"


def origin(result: Result) -> str:
    """Where figures come from; those of an earlier version tell their commit and versions otherwise."""
    if "provenance" in result or "versions" not in result:
        return line(result.get("provenance"))
    seeds = sorted({seed for of in result["tables"] for seed in of["seeds"]})
    versions = ", ".join(f"{name} {number}" for name, number in result["versions"].items())
    return f"*commit {result['commit'] or 'unknown'}, seeds {seeds[0]} to {seeds[-1]}; {versions}.*"


def script(section: str) -> str:
    """Which wrote the figures of a section; two sections may come from one."""
    return f"{section.split('_')[0]}.py"


# ---- acceptance.py ---------------------------------------------------------------------------------------------------


def acceptance(result: Result) -> str:
    """The promised cells: wrong verdicts, returns against the oracle's, AUROC."""
    played = [cell for cell in result["cells"] if "oracle" in cell]
    rows = []
    for cell in played:
        names = ("rpil", "trust_all")
        cells = bold_best([mean_se(cell[name]) for name in names], [cell[name]["mean"] for name in names], 1)
        rows.append([cell["env"], cell["kind"], cell["features"], f"{cell['wrong']}", *cells, mean_se(cell["oracle"])])
    missed = [
        f"{cell['env']}, {cell['kind']}, {cell['features']}: missed {and_list(cell['missed'])} ({figures(cell)})."
        for cell in result["cells"]
        if cell["missed"]
    ]
    draws = and_list(sorted({str(cell["draws"]) for cell in result["cells"]}))
    return "\n\n".join(
        [
            "## Acceptance",
            f"`benchmarks/acceptance.py`, {draws} draws of 10 good and 10 bad demonstrations; mean return ± one "
            "standard error over draws, wrong verdicts of all draws (“open” is no verdict). The better of R-PIL and "
            "trusting all is bold; the oracle learned from the good ones alone.",
            table(["environment", "bad half", "features", "wrong", "R-PIL", "trust all", "clean oracle"], rows, 3),
            bullets([*other_cells(result["cells"]), *(missed or ["Nothing that was promised is missed."])]),
        ]
    )


def other_cells(cells: list[Result]) -> list[str]:
    """The cells in which no policy plays: partly bad demonstrations, and coherent ones."""
    aurocs = [cell["auroc"] for cell in cells if "oracle" not in cell and "ambiguous" not in cell]
    coherent = [cell for cell in cells if "ambiguous" in cell]
    lines = []
    if aurocs:
        lines.append(f"Partly bad demonstrations, {len(aurocs)} cells: AUROC {min(aurocs):.3f} in the worst draw.")
    if coherent:
        ambiguous, both, draws = (sum(of[key] for of in coherent) for key in ("ambiguous", "both", "draws"))
        least = min(of["auroc_answered"] for of in coherent)
        lines.append(
            f"All actions of the bad half shifted: ambiguous in {ambiguous} of {draws} draws; the pair that is asked "
            f"about holds one of either half in {both}; with its answer, AUROC {least:.3f} in the worst draw."
        )
    return lines


def mean_se(of: Result) -> str:
    return f"{of['mean']:.1f} ± {of['se']:.1f}"


def figures(cell: Result) -> str:
    """The figures that a missed goal is about."""
    said = {
        "verdicts": lambda: f"{cell['wrong']} wrong verdicts",
        "words": lambda: f"a word for {cell['given']:.0%}",
        "return": lambda: f"{cell['behind']:.1f} behind the oracle, whose standard error is {cell['oracle']['se']:.1f}",
        "time": lambda: f"{cell['seconds']:.1f} s a fit",
        "auroc": lambda: f"AUROC {cell['auroc']:.3f} in the worst draw",
        "ambiguous": lambda: f"ambiguous in {cell['ambiguous']} of {cell['draws']} draws",
        "pair": lambda: f"the pair holds one of either half in {cell['both']} of {cell['draws']} draws",
        "answered": lambda: f"AUROC {cell['auroc_answered']:.3f} with the pair answered, in the worst draw",
    }
    return and_list([said[goal]() for goal in cell["missed"]])


# ---- paper.py --------------------------------------------------------------------------------------------------------

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


# ---- robustness.py ---------------------------------------------------------------------------------------------------


def robustness(result: Result, title: str = "Robustness") -> str:
    """The grid: returns, AUROC and wrong verdicts of every cell, and methods over all that can be known."""
    cells = {(cell["env"], cell["share"], cell["kind"]): cell for cell in result["cells"]}
    kinds = list(dict.fromkeys(kind for _, _, kind in cells))
    rows = [
        [env, f"{share} %", *(in_grid(cells.get((env, share, kind))) for kind in kinds)]
        for env, share in dict.fromkeys((env, share) for env, share, _ in cells)
    ]
    of = result["configuration"]
    parts = [
        f"## {title}",
        f"`benchmarks/robustness.py`: {of['n_good']} good demonstrations, draws {result['draws']}, from seed "
        f"{result['first_seed']}, {of['rollouts']} rollouts a policy, features `{of['features']}`, one configuration "
        "for all cells. Normalised return (0 plays like uniform actions, 1 like the clean oracle) / AUROC / wrong "
        "verdicts. A † marks a missed goal, a * cells that cannot be known without labels, scored with one of each "
        "sort.",
        table(["environment", "bad", *kinds], rows, 2),
        bullets(missed_in_grid(result)),
    ]
    if result["methods"]:
        parts += [
            "Every method on the cells that can be known, on the same draws: mean over cells, and the worst cell.",
            methods_table(result["methods"]),
            bullets(behind_in_grid(result["methods"])),
        ]
    return "\n\n".join(parts)


def in_grid(cell: Result | None) -> str:
    if cell is None:
        return ""
    shown = [
        "–" if cell[score] is None else form.format(cell[score]["mean"])
        for score, form in (("return", "{:.2f}"), ("auroc", "{:.3f}"), ("wrong", "{:.1%}"))
    ]
    return " / ".join(shown) + "*" * cell["unknowable"] + "†" * bool(cell["missed"])


def missed_in_grid(result: Result) -> list[str]:
    """Each goal: reached, or the cells that miss it with their figures."""
    shown = {
        "return": ("normalised return", "return", "{:.3f}"),
        "AUROC": ("AUROC", "auroc", "{:.3f}"),
        "verdicts": ("wrong verdicts", "wrong", "{:.1%}"),
        "words": ("a word for most", "given", "{:.0%}"),
        "ambiguous": ("“ambiguous” in every draw", "ambiguous", ""),
    }

    def figure(cell: Result, score: str, form: str) -> str:
        if score == "ambiguous":
            return f"{cell['ambiguous']} of {cell['unlabelled_draws']} draws"
        return "not measured" if cell[score] is None else form.format(cell[score]["mean"])

    lines = []
    for goal, (name, score, form) in shown.items():
        asked = [cell for cell in result["cells"] if goal != "ambiguous" or cell["unknowable"]]
        missed = [cell for cell in asked if goal in cell["missed"]]
        where = [f"{cell['env']} {cell['kind']} {cell['share']} % ({figure(cell, score, form)})" for cell in missed]
        said = f"missed in {len(missed)} of {len(asked)} cells: {and_list(where)}" if missed else "reached in all cells"
        lines.append(f"Goal for {name}: {said if asked else 'no cell asks for it'}.")
    if result["missing"]:
        lines.append(f"{result['missing']} pieces of work failed or are not done.")
    return lines


SCORES = {"auroc": "AUROC", "normalised": "normalised return"}


def methods_table(methods: list[Result]) -> str:
    columns = [(score, of) for score in SCORES for of in ("mean", "worst")]
    cells = {
        row["method"]: [
            ("–", None) if row[score] is None else (f"{row[score][of]:.3f}", row[score][of]) for score, of in columns
        ]
        for row in methods
        if row["method"] != "oracle"
    }
    return by_column([f"{SCORES[score]}, {of}" for score, of in columns], cells, digits=3)


def behind_in_grid(methods: list[Result]) -> list[str]:
    """Scores in which a method is above ours; the oracle knows the truth and does not count."""
    known = {row["method"]: row for row in methods if row["method"] != "oracle"}
    ours, lines = known.pop(OURS, None), []
    if ours is None:
        return ["Ours was not measured."]
    for score, name in SCORES.items():
        for of in ("mean", "worst") if ours[score] else ():
            known_to = [(row[score][of], peer) for peer, row in known.items() if row[score]]
            above = [(value, peer) for value, peer in known_to if value > ours[score][of]]
            better = [f"{peer} {value:.3f}" for value, peer in sorted(above, reverse=True)]
            if better:
                lines.append(f"Not the best in {name}, {of}: ours {ours[score][of]:.3f}, {and_list(better)}.")
    return lines or ["Ours is the best, or as good, in every column."]


# ---- sections that scripts write themselves --------------------------------------------------------------------------


def section_of(script: str) -> Callable[[Result], str]:
    """The section that the script itself writes; it is imported only where there are figures of it."""

    def section(result: Result) -> str:
        text: str = importlib.import_module(script).markdown(result)
        return text

    return section


SECTIONS: dict[str, Callable[[Result], str]] = {
    "claims": section_of("claims"),
    "worlds": section_of("worlds"),
    "answers": section_of("answers"),
    "trust": section_of("trust_report"),
    "ablations": section_of("ablations"),
    "acceptance": acceptance,
    "paper": paper,
    "features": section_of("features"),
    "robustness": robustness,
    "robustness_continuous": partial(robustness, title="Robustness, continuous actions"),
    "real": real_report.markdown,
    "real_continuous": partial(real_report.markdown, title="Real demonstrations, continuous actions"),
    "demonstrators": section_of("demonstrators"),
}

if __name__ == "__main__":
    sys.stdout.reconfigure(encoding="utf-8")  # type: ignore[union-attr]
    raise SystemExit(main())
