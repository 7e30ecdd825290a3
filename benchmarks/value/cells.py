"""Each cell of what `policy_value.py` wrote: a family, learner, task, number and share, over seeds.

In a cell a rule and `all` are driven from the same starts with policies of the same data sets. The interval of their
difference is Student's over seeds, two-sided at 95 %. The worst cell of a rule is the one with the lowest lower end: as
the least of many it lies lower than its own cell's, never higher.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import t as student

from rpil.numerics.types import Array
from tables import table
from value.rules import ALL, RULES
from value.worlds import FAMILIES, TASKS, family

Row = dict[str, Any]
CELL = ("learner", "task", "n", "share")
LEVEL = 0.95
HARM = -0.05
"""A lower end below this counts as harm."""
FEWEST_SEEDS = 3


@dataclass(frozen=True)
class Interval:
    mean: float
    half: float
    count: int
    """Of seeds."""

    @classmethod
    def of(cls, values: Array) -> Interval:
        """Of the mean of at least two differences, (S,)."""
        half = student.ppf((1 + LEVEL) / 2, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
        return cls(float(values.mean()), float(half), len(values))

    @property
    def low(self) -> float:
        return self.mean - self.half

    def __str__(self) -> str:
        return f"{signed(self.mean)} ± {percent(self.half)}"


@dataclass(frozen=True)
class Cell:
    place: tuple[Any, ...]
    """Values of `CELL`."""
    success_of_all: float
    minus_all: dict[str, Interval]
    """By rule."""

    @property
    def group(self) -> tuple[str, str]:
        return family(self.place[1]), self.place[0]

    @property
    def name(self) -> str:
        _, task, n, share = self.place
        return f"{task}, {n}, {share:.0%}"


def cells_of(rows: Sequence[Row]) -> list[Cell]:
    """The cells in which enough seeds compare a rule with all, in the order of families, tasks and shares."""
    success: dict[tuple[Any, ...], dict[str, dict[int, float]]] = defaultdict(lambda: defaultdict(dict))
    for row in rows:
        success[tuple(row[name] for name in CELL)][row["rule"]][row["seed"]] = row["success"]
    found = []
    for place in sorted(success, key=lambda place: (place[0], TASKS.index(place[1]), *place[2:])):
        of_rule = success[place]
        intervals = {
            rule: Interval.of(np.array([of_rule[rule][seed] - of_rule[ALL][seed] for seed in sorted(seeds)]))
            for rule in RULES
            if rule != ALL and len(seeds := of_rule[rule].keys() & of_rule[ALL].keys()) >= FEWEST_SEEDS
        }
        if intervals:
            found.append(Cell(place, float(np.mean([*of_rule[ALL].values()])), intervals))
    return found


def worst(cells: Sequence[Cell]) -> str:
    """The worst cell of each family, learner and rule, in Markdown."""
    lines = []
    for group, own in groups(cells):
        for rule in [name for name in RULES if any(name in cell.minus_all for cell in own)]:
            judged = [cell for cell in own if rule in cell.minus_all]
            lowest = min(judged, key=lambda cell: cell.minus_all[rule].low)
            harmed = sum(cell.minus_all[rule].low < HARM for cell in judged)
            interval = lowest.minus_all[rule]
            widest = max(cell.minus_all[rule].half for cell in judged)
            numbers = [percent(lowest.success_of_all), str(interval), signed(interval.low)]
            counts = [f"{harmed} of {len(judged)}", percent(widest), str(interval.count)]
            lines.append([rule, ", ".join(group), lowest.name, *numbers, *counts])
    header = ["rule", "worlds", "worst cell: task, number, share", "all", "gain over all", "lower end"]
    header += [f"cells below {100 * HARM:+.0f}", "widest half-width", "seeds"]
    return f"### Worst cells\n\n{table(header, lines, text_columns=3)}"


def cell_tables(cells: Sequence[Cell]) -> list[str]:
    """A table of the cells of each family and learner: differences to all, and half-widths."""
    parts = []
    for group, own in groups(cells):
        rules = [rule for rule in RULES if any(rule in cell.minus_all for cell in own)]
        lines = [
            [cell.name, percent(cell.success_of_all), *(str(cell.minus_all.get(rule, "")) for rule in rules)]
            for cell in own
        ]
        means = [
            signed(np.mean([cell.minus_all[rule].mean for cell in own if rule in cell.minus_all])) for rule in rules
        ]
        lines.append(["mean", percent(np.mean([cell.success_of_all for cell in own])), *means])
        title = "### Cells: {}, {}".format(*group)
        parts.append(f"{title}\n\n{table(['task, number, share', ALL, *rules], lines)}")
    return parts


def groups(cells: Sequence[Cell]) -> list[tuple[tuple[str, str], list[Cell]]]:
    """Families and learners, and their cells."""
    present = sorted({cell.group for cell in cells}, key=lambda group: (FAMILIES.index(group[0]), group[1]))
    return [(group, [cell for cell in cells if cell.group == group]) for group in present]


def signed(value: Any) -> str:
    return f"{round(100 * float(value), 1) + 0.0:+.1f}"  # -0.0 + 0.0 is 0.0


def percent(value: Any) -> str:
    return f"{100 * float(value):.1f}"
