"""Tables of what `policy_value.py` wrote."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from rpil.numerics.types import Array
from tables import table
from value.cells import cell_tables, cells_of, percent, worst
from value.rules import ALL, RULES
from value.worlds import family

Row = dict[str, Any]
LEVEL = 0.05
FEWEST_SEEDS = 3
"""Of a cell in which a rule can be worse than all."""
CURVE = ("best 40 %", "best 60 %", "best 80 %", ALL)


def report(rows: Sequence[Row]) -> str:
    """All tables in Markdown: the worst cells, all cells, means."""
    groups = sorted({group(row) for row in rows})
    parts = [comparison(rows, "All worlds and learners")] if len(groups) > 1 else []
    for each in groups:
        own = [row for row in rows if group(row) == each]
        parts.append(comparison(own, "{}, {}".format(*each)))
    cells = cells_of(rows)
    led = [worst(cells), *cell_tables(cells)] if cells else []
    return "\n\n".join([*led, *parts, never_hurts(rows), commits(rows)])


def group(row: Row) -> tuple[str, str]:
    return family(row["task"]), row["learner"]


def comparison(rows: Sequence[Row], title: str) -> str:
    """Each rule against training on all demonstrations, paired over tasks and seeds."""
    names, present = rules_of(rows), sorted({family(row["task"]) for row in rows})
    present = present if len(present) > 1 else []
    differences = {name: paired(rows, name) for name in names}
    compared = [name for name in names if name != ALL]
    worse = dict(zip(compared, holm([p_lower(differences[name]) for name in compared]), strict=True))
    better = dict(zip(compared, holm([p_lower(-differences[name]) for name in compared]), strict=True))
    cells = []
    for name in names:
        own = [row for row in rows if row["rule"] == name]
        families = [[row for row in own if family(row["task"]) == each] for each in present]
        means = [percent(np.mean([row["success"] for row in each])) if each else "" for each in (own, *families)]
        tests = [f"{found[name]:.3f}" if name in found else "" for found in (worse, better)]
        steps = [row["mean_steps"] for row in own if row.get("mean_steps") is not None]
        shares = [percent(np.mean([row[what] for row in own])) for what in ("kept", "weight_on_good")]
        cells.append(
            [name, *means, *difference(differences[name]), *tests, *shares, f"{np.mean(steps):.0f}" if steps else ""]
        )
    header = ["rule", "success", *present, "gain over all", "standard error", "sets"]
    header += ["P worse", "P better", "steps kept", "weight on good", "steps"]
    said = [name for name in compared if worse[name] < LEVEL]
    note = f"Credibly worse than all (Holm, {LEVEL:.0%}): {', '.join(said) or 'none'}."
    return f"### {title}\n\n{table(header, cells)}\n\n{note}"


def never_hurts(rows: Sequence[Row]) -> str:
    """Cells (task, share, learner) in which a rule that is told no truth is worse than all, paired over seeds, and
    tasks in which its mean over all cells is."""
    cells, tasks = split(rows, "task", "share", "learner"), split(rows, "task")
    names = [name for name in rules_of(rows) if name != ALL and "is_good" not in RULES[name].needs]
    found = {name: [p_lower(v) for own in cells if len(v := paired(own, name)) >= FEWEST_SEEDS] for name in names}
    adjusted = iter(holm([p for of_rule in found.values() for p in of_rule]))
    lines = []
    for name in names:
        worse = sum(next(adjusted) < LEVEL for _ in found[name])
        means = [
            (own[0]["task"], values)
            for own in tasks
            if len(values := paired(own, name)) and round(values.mean(), 9) < 0
        ]
        losses = [
            f"{task} {mean} ± {error or '?'}" for task, (mean, error, _) in ((t, difference(v)) for t, v in means)
        ]
        lines.append([name, ", ".join(losses) or "none", str(len(found[name])), str(worse)])
    text = (
        "A loss is a task with a mean below that of all: the difference ± its standard error. A cell is a task, share "
        f"and learner with {FEWEST_SEEDS} seeds or more; worse: at {LEVEL:.0%} by Holm's correction over cells, rules."
    )
    header = ["rule", "losses by task", "cells", "worse"]
    return f"### Losses\n\n{text}\n\n{table(header, lines, text_columns=2)}"


def split(rows: Sequence[Row], *names: str) -> list[list[Row]]:
    """The rows that have the same values, together."""
    found: dict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for row in rows:
        found[tuple(row[name] for name in names)].append(row)
    return list(found.values())


def commits(rows: Sequence[Row]) -> str:
    """How many cells each commit made."""
    said = Counter((row.get("commit"), bool(row.get("dirty"))) for row in rows)
    names = [
        f"{count} of {commit or 'no known commit'}" + " with uncommitted changes" * dirty
        for (commit, dirty), count in said.items()
    ]
    return f"*Cells by commit: {', '.join(names)}.*"


def rules_of(rows: Iterable[Row]) -> list[str]:
    present = {row["rule"] for row in rows}
    return [name for name in RULES if name in present]


def paired(rows: Sequence[Row], name: str) -> Array:
    """Success of a rule less that of all, for each task and seed: the mean over what both have in common."""
    found: dict[str, dict[tuple[Any, ...], float]] = {name: {}, ALL: {}}
    for row in rows:
        if row["rule"] in found:
            place = (row["task"], row["seed"], row["n"], row["share"], row["learner"])
            found[row["rule"]][place] = row["success"]
    units: dict[tuple[Any, ...], list[float]] = defaultdict(list)
    for place in found[name].keys() & found[ALL].keys():
        units[place[:2]].append(found[name][place] - found[ALL][place])
    return np.array([np.mean(units[unit]) for unit in sorted(units)])


def difference(values: Array) -> tuple[str, str, str]:
    """The mean, its standard error and their number."""
    error = f"{100 * values.std(ddof=1) / np.sqrt(len(values)):.1f}" if len(values) > 1 else ""
    return f"{100 * values.mean():+.1f}" if len(values) else "", error, str(len(values))


def p_lower(values: Array) -> float:
    """One-sided t test of a mean below 0."""
    if len(values) < 2 or not values.std() > 0:
        return float(len(values) < 2 or values.mean() >= 0)
    return float(student.cdf(values.mean() / (values.std(ddof=1) / np.sqrt(len(values))), len(values) - 1))


def holm(p: Sequence[float]) -> list[float]:
    """P values for all of several tests together (Holm 1979)."""
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(np.maximum.accumulate((len(p) - np.arange(len(p))) * np.sort(p)), 1.0)
    return [float(value) for value in adjusted]


def picture(rows: Sequence[Row], path: Path) -> None:
    """Success against the share of the steps kept: a row of panels for each learner, a column for each family and share
    of bad demonstrations; a line joins the rules that keep the best."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    learners = sorted({row["learner"] for row in rows})
    places = sorted({(family(row["task"]), row["share"]) for row in rows})
    size = (2.9 * len(places), 2.9 * len(learners) + 0.7)
    figure, axes = plt.subplots(len(learners), len(places), figsize=size, sharex=True, sharey=True, squeeze=False)
    figure.set_layout_engine("constrained")
    colours = dict(zip(rules_of(rows), plt.get_cmap("tab20").colors, strict=False))  # type: ignore[attr-defined]
    for axis, (learner, (kind, share)) in zip(axes.flat, product(learners, places), strict=True):
        own = [row for row in rows if group(row) == (kind, learner) and row["share"] == share]
        axis.set_visible(bool(own))
        points = {
            name: [100 * np.mean([row[what] for row in own if row["rule"] == name]) for what in ("kept", "success")]
            for name in rules_of(own)
        }
        curve = [points[name] for name in points if name in CURVE]
        axis.plot(*zip(*sorted(curve), strict=True), color="0.6", zorder=1)
        for name, (kept, success) in points.items():
            marker = "o" if RULES[name].needs else "s"
            axis.plot(kept, success, marker, color=colours[name], label=name, markersize=8)
        axis.set(title=f"{kind}, {share:.0%} bad", xlabel="steps kept, %", ylabel=f"{learner}: success, %")
        axis.label_outer()
    labelled = {text: mark for axis in axes.flat for mark, text in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend(labelled.values(), labelled.keys(), loc="outside lower center", ncols=8, frameon=False)
    figure.savefig(path, dpi=80)
    plt.close(figure)
