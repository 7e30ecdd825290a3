"""Tables in Markdown of what was run, worst cell first.

A difference is that of a column to "all" in the same draw, in points of the policy. Draws of a cell share nothing but
the world, so that intervals are Student's, over seeds, with the deviation within cells that all cells of a world have
in common: of S seeds and C cells it has C (S - 1) degrees of freedom.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from .columns import COLUMNS
from .goals import WORTH, gained, goals
from .intervals import half_widths
from .peers import ALL, ORACLE

Row = dict[str, Any]
HEADER = (
    "column",
    "worst cell, less all",
    "which",
    "±",
    "mean, less all",
    "±",
    "policy",
    "AUROC",
    "lowest AUROC",
    "CPU s",
)


@dataclass(frozen=True)
class Summary:
    """A column in a world; None where nothing was measured."""

    worst: float | None
    """Points by which the mean over seeds differs from "all" in the cell where this is least."""
    worst_cell: str
    detectable: float | None
    """Half-width of the 95 % interval of the difference in one cell."""
    gain: float | None
    """The mean difference over cells, and its half-width."""
    gain_interval: float | None
    policy: float | None
    auroc: float | None
    lowest: float | None
    """The lowest mean AUROC of a cell."""
    seconds: float | None


def read(folder: Path) -> list[Row]:
    """What was run, in the order of the names of the files."""
    return [in_points(json.loads(path.read_text(encoding="utf-8"))) for path in sorted(folder.glob("*.json"))]


def in_points(draw: Row) -> Row:
    """The draw with policies in points: of a hundred, which is what its world calls whole."""
    for row in draw["columns"].values():
        row["policy"] = None if row["policy"] is None else 100 * row["policy"] / draw.get("whole", 100.0)
    return draw


def summarised(draws: Sequence[Row], column: str) -> Summary | None:
    """A column over the draws of one world, or None where no draw has it."""
    rows = [(draw["cell"], draw["columns"][column], draw["columns"].get(ALL, {})) for draw in draws]
    less, values = defaultdict[str, list[float]](list), {key: defaultdict[str, list[float]](list) for key in MEASURED}
    for cell, row, everything in rows:
        for key in MEASURED:
            if row[key] is not None:
                values[key][cell].append(row[key])
        if row["policy"] is not None and everything.get("policy") is not None:
            less[cell].append(row["policy"] - everything["policy"])
    if not any(values[key] for key in MEASURED):
        return None
    means = {cell: float(np.mean(own)) for cell, own in less.items()}
    worst_cell = min(means, key=lambda cell: means[cell], default="")
    in_cell, of_mean = half_widths(less, worst_cell)
    aurocs = by_cell(values["auroc"])
    return Summary(
        means.get(worst_cell),
        worst_cell,
        in_cell,
        mean(means.values()),
        of_mean,
        mean(by_cell(values["policy"])),
        mean(aurocs),
        min(aurocs, default=None),
        mean(by_cell(values["seconds"])),
    )


MEASURED = "auroc", "policy", "seconds"


def by_cell(values: dict[str, list[float]]) -> list[float]:
    return [float(np.mean(own)) for own in values.values()]


def mean(values: Iterable[float]) -> float | None:
    found = list(values)
    return float(np.mean(found)) if found else None


def line(name: str, found: Summary | None) -> list[str]:
    """The cells of a row of the table."""
    if found is None:
        return [name, *["–"] * (len(HEADER) - 1)]
    return [
        name,
        number(found.worst, "+.1f"),
        found.worst_cell or "–",
        number(found.detectable, ".1f"),
        number(found.gain, "+.1f"),
        number(found.gain_interval, ".1f"),
        number(found.policy, ".1f"),
        number(found.auroc, ".3f"),
        number(found.lowest, ".3f"),
        number(found.seconds, ".1f"),
    ]


def number(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def table(rows: Iterable[Sequence[str]]) -> str:
    return plain(HEADER, rows)


def of_world(draws: Sequence[Row]) -> str:
    """The section of one world."""
    first = draws[0]
    cells, seeds = sorted({draw["cell"] for draw in draws}), sorted({draw["seed"] for draw in draws})
    columns = [name for name in COLUMNS if any(name in draw["columns"] for draw in draws)]
    rows = []
    for name in columns:
        rows.append(line(name, summarised([draw for draw in draws if name in draw["columns"]], name)))
    text = (
        f"Source: {first['source']}; licence: {first['licence']}. Published: {first['published']}. "
        f"Here: {len(cells)} cells, {len(seeds)} seeds, {len(draws)} draws"
        + (", `--quick`." if first["quick"] else ".")
    )
    return "\n\n".join([f"## {first['world']}", text, table(rows)])


def across(draws: Sequence[Row], brief: bool = False) -> str:
    """Tables over all worlds: how far each column is from all, AUROC, figures of others, and the goals; with `brief`
    one line for each column, and the goals."""
    worlds = {name: [draw for draw in draws if draw["world"] == name] for name in sorted({d["world"] for d in draws})}
    found: dict[str, dict[str, Summary]] = defaultdict(dict)
    for name, (world, own) in product(COLUMNS, worlds.items()):
        has = [draw for draw in own if name in draw["columns"]]
        if (summary := summarised(has, name)) is not None:
            found[name][world] = summary
    aims = "Goals.", plain(GOALS, goals(worlds))
    if brief:
        return "\n\n".join([run_of(worlds), plain(IN_SHORT, [in_short(draws, *each) for each in found.items()]), *aims])
    moved, ranked = [], []
    for name, own in found.items():
        less = [
            f"{whole(each.worst)}/{whole(each.gain)}" if each.worst is not None else "–" for each in in_all(own, worlds)
        ]
        worst = min((each.worst for each in own.values() if each.worst is not None), default=None)
        moved.append([name, whole(worst), *less, of_worth(draws, name)])
        ranked.append([name, *(number(each.auroc, ".2f") for each in in_all(own, worlds))])
    finest = [number(each.detectable, ".0f") for each in in_all(found[ORACLE], worlds)]
    moved.append([f"± of a cell, {ORACLE}", "", *finest, ""])
    header = ["column", "worst", *worlds, f"+{WORTH:.0f} where {ORACLE} has it"]
    ends = [{world: each.policy for world, each in found[name].items()} for name in (ALL, ORACLE)]
    beside = [[*about(own), *(number(end.get(world), ".1f") for end in ends)] for world, own in worlds.items()]
    tables = {
        "Worst cell/mean of cells, in points less all; last, cells that gain where the truth does.": (header, moved),
        "AUROC, mean of cells.": (["column", *worlds], ranked),
        "Published, and here.": (BESIDE, beside),
    }
    return "\n\n".join([part for text, rows in tables.items() for part in (text, plain(*rows))] + [*aims])


IN_SHORT = "column", "worst cell, less all", "±", "in", "mean", f"+{WORTH:.0f} where {ORACLE} has it", "AUROC"


def run_of(worlds: Mapping[str, Sequence[Row]]) -> str:
    """Say how much of each world was run."""
    return f"Cells x seeds: {', '.join(f'{world} {about(own)[1]}' for world, own in worlds.items())}."


def in_short(draws: Sequence[Row], name: str, own: Mapping[str, Summary]) -> list[str]:
    """The worst cell of a column in all worlds, the mean of its worlds, and where it gains."""
    driven = {world: each for world, each in own.items() if each.worst is not None}
    world = min(driven, key=lambda world: driven[world].worst or 0.0, default="–")
    lowest = driven.get(world, NOTHING)
    return [
        name,
        number(lowest.worst, "+.1f"),
        number(lowest.detectable, ".1f"),
        world,
        number(mean(each.gain for each in driven.values() if each.gain is not None), "+.1f"),
        of_worth(draws, name),
        number(mean(each.auroc for each in own.values() if each.auroc is not None), ".2f"),
    ]


NOTHING = Summary(None, "", None, None, None, None, None, None, None)
GOALS = "goal", "here"
BESIDE = "world", "cells x seeds", "published", f"here: {ALL}", f"here: {ORACLE}"


def about(draws: Sequence[Row]) -> list[str]:
    """The world of these draws, how much of it was run, and the figures of others."""
    cells, seeds = (len({draw[key] for draw in draws}) for key in ("cell", "seed"))
    return [draws[0]["world"], f"{cells}x{seeds}", draws[0]["published"]]


def whole(value: float | None) -> str:
    return "–" if value is None else f"{round(value):+d}"


def in_all(own: Mapping[str, Summary], worlds: Iterable[str]) -> list[Summary]:
    return [own.get(world, NOTHING) for world in worlds]


def of_worth(draws: Sequence[Row], name: str) -> str:
    """Of the cells in which the oracle gains `WORTH` points over all, those in which the column does."""
    count, most = gained(draws, name)
    return f"{count}/{most}"


def plain(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, rule, *rows))


def finished(draws: Sequence[Row]) -> list[Row]:
    """The draws that have as many columns as any of their world: columns are compared over the same draws."""
    most = {
        world: max(len(d["columns"]) for d in draws if d["world"] == world) for world in {d["world"] for d in draws}
    }
    return [draw for draw in draws if len(draw["columns"]) == most[draw["world"]]]


def page(draws: Sequence[Row], brief: bool = False) -> str:
    """All worlds that were run, and which commit they are of; `brief` leaves out AUROC and the table of each world."""
    if not draws:
        raise SystemExit("nothing was run yet; see python -m rpil_outside run --help")
    commit, *others = sorted({str(draw["commit"]) for draw in draws})
    if others:
        raise SystemExit(f"the figures are of commits {commit}, {', '.join(others)}; run them on one.")
    draws = finished(draws)
    worlds = list(dict.fromkeys(draw["world"] for draw in draws))
    sections = [] if brief else [of_world([draw for draw in draws if draw["world"] == world]) for world in worlds]
    return "\n\n".join([f"Commit {commit}.", across(draws, brief), *sections]) + "\n"
