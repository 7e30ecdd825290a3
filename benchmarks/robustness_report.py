"""What the rows of `robustness.py` say: cells against the goals, methods side by side, a table and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from grid import unknowable
from rpil.simulation.corruptions import KINDS
from rpil.simulation.rollouts import Returns

RETURN, AUROC, WRONG, GIVEN = 0.95, 0.99, 0.005, 0.8
GOALS = {
    "return": f"normalised return of {RETURN} at least",
    "AUROC": f"AUROC of {AUROC} at least",
    "verdicts": f"wrong verdicts of {100 * WRONG:g} % at most",
    "words": f"a word for {100 * GIVEN:g} % at least, where it can be known",
    "ambiguous": "“two groups” without labels in every draw of such cells",
}
OURS, LABELLED, REFERENCE = "rpil", "rpil, two labels", "reference"
PANELS = (
    ("return", "return", ".2f", 1.0, 0.5),
    ("AUROC", "auroc", ".3f", 1.0, 0.8),
    ("verdicts", "wrong", ".1%", 0.0, 0.2),
)
"""Goal, score, its format, and what is shown palest and darkest."""

Row = dict[str, Any]


def summary(rows: list[Row], n_wanted: int) -> Row:
    """Cells, each against the goals, and methods over the cells in which the answer can be known."""
    references = {(row["env"], row["seed"]): row for row in rows if row["method"] == REFERENCE}
    rows = [row | normalised(row, references) for row in rows if row["method"] != REFERENCE]
    places = list(dict.fromkeys(map(place, rows)))
    cells = [cell([row for row in rows if place(row) == at]) for at in places]
    goals = {goal: [name_of(cell) for cell in cells if goal in cell["missed"]] for goal in GOALS}
    missing = n_wanted - len(rows) - len(references)
    reached = missing == 0 and not any(goals.values())
    return {"reached": reached, "missing": missing, "missed": goals, "cells": cells, "methods": methods(rows)}


def place(row: Row) -> tuple[str, str, int]:
    return row["env"], row["kind"], row["share"]


def name_of(cell: Row) -> str:
    return f"{cell['env']} {cell['kind']} {cell['share']} %"


def normalised(row: Row, references: dict[tuple[str, int], Row]) -> Row:
    """0 plays like uniform actions, 1 like the oracle; nothing where the oracle itself is no better than they are."""
    against = references.get((row["env"], row["seed"]))
    if against is None or "return" not in row or against["oracle"] <= against["random"]:
        return {}
    return {"normalised": (row["return"] - against["random"]) / (against["oracle"] - against["random"])}


def cell(rows: list[Row]) -> Row:
    """Means over the draws of one cell with 95 % t intervals, which goals they miss, and the seeds of draws that do."""
    alone = [row for row in rows if row["method"] == OURS]
    hopeless = unknowable(rows[0]["kind"], rows[0]["share"])
    scored = [row for row in rows if row["method"] == LABELLED] if hopeless else alone
    found: Row = dict(zip(("env", "kind", "share"), place(rows[0]), strict=True)) | {
        "unknowable": hopeless,
        "draws": len(scored),
        "ambiguous": sum(not row["identifiable"] for row in alone),
        "unlabelled_draws": len(alone),
        "return": mean_of(scored, "normalised"),
        "auroc": mean_of(scored, "auroc"),
        "wrong": mean_of(scored, "wrong"),
        "given": mean_of(scored, "given"),
        "prior": mean_of(scored, "prior"),
        "brier": float(np.mean([brier(row) for row in scored])) if scored else None,
        "seconds": float(np.median([row["seconds"] for row in scored])) if scored else None,
        "adversaries": counts(scored, "adversary"),
        "features": counts(scored, "features"),
    }
    means = {name: seen["mean"] for name in ("return", "auroc", "wrong", "given") if (seen := found[name]) is not None}
    if hopeless:
        means.pop("given", None)
    guessed = [row["seed"] for row in alone if hopeless and row["identifiable"]]
    found["missed"] = goals_missed(means) + ["ambiguous"] * (len(guessed) > 0)
    behind = [row["seed"] for row in scored if goals_missed(row | {"return": row.get("normalised", -np.inf)})]
    found["seeds"] = sorted({*guessed, *behind})
    return found


def goals_missed(scores: Row) -> list[str]:
    """Of a normalised return, an AUROC and a share of wrong verdicts, which must be there, and of a share with a word;
    up to rounding."""
    return [
        goal
        for goal, missed in (
            ("return", scores.get("return", -np.inf) < RETURN - 1e-9),
            ("AUROC", scores.get("auroc", -np.inf) < AUROC - 1e-9),
            ("verdicts", scores.get("wrong", np.inf) > WRONG + 1e-9),
            ("words", scores.get("given", 1.0) < GIVEN - 1e-9),
        )
        if missed
    ]


def mean_of(rows: list[Row], name: str) -> Row | None:
    values = np.array([row[name] for row in rows if name in row])
    if not len(values):
        return None
    seen = Returns.of(values)  # the t interval that returns have
    low, high = seen.ci95 if len(values) > 1 else (None, None)
    return {"mean": seen.mean, "low": low, "high": high, "min": float(values.min()), "max": float(values.max())}


def brier(row: Row) -> float:
    return float(np.mean(np.square(np.array(row["expert_proba"]) - row["good"])))


def counts(rows: list[Row], name: str) -> dict[str, int]:
    values = [row[name] for row in rows]
    return {value: values.count(value) for value in dict.fromkeys(values)}


def methods(rows: list[Row]) -> list[Row]:
    """Every method over the cells that can be known, on the draws that the peers have too."""
    names = [name for name in dict.fromkeys(row["method"] for row in rows) if name != LABELLED]
    draws = [{(*place(row), row["seed"]) for row in rows if row["method"] == name} for name in names]
    shared = {draw for draw in set.intersection(*draws) if not unknowable(*draw[1:3])} if len(names) > 1 else set()
    found = []
    for name in names if shared else []:
        mine = [row for row in rows if row["method"] == name and (*place(row), row["seed"]) in shared]
        per_cell = [[row for row in mine if place(row) == at] for at in dict.fromkeys(map(place, mine))]
        record: Row = {"method": name, "cells": len(per_cell), "draws": len(mine)}
        for score in ("auroc", "normalised"):
            means = [seen["mean"] for rows in per_cell if (seen := mean_of(rows, score)) is not None]
            record[score] = {"mean": float(np.mean(means)), "worst": float(min(means))} if means else None
        found.append(record | {"seconds": float(np.median([row["seconds"] for row in mine]))})
    return found


def table(found: Row) -> str:
    """What `summary` found, for people: means, returns with their 95 % intervals over draws."""
    lines = [f"{'':47}{'return':>20}{'AUROC':>8}{'wrong':>8}{'prior':>7}{'ambiguous':>11}{'s':>7}  missed"]
    for cell in found["cells"]:
        name = f"{name_of(cell)}{', two labels' if cell['unknowable'] else ''}"
        cells_text = [
            f"{name:47}{interval(cell['return']):>20}",
            f"{number(cell['auroc'], '.3f'):>8}{number(cell['wrong'], '.1%'):>8}{number(cell['prior'], '.2f'):>7}",
            f"{cell['ambiguous']:>8}/{cell['unlabelled_draws']:<2}{cell['seconds'] or 0:7.1f}",
            f"  {', '.join(cell['missed'])}"
            + (f" (seeds {', '.join(map(str, cell['seeds']))})" if cell["seeds"] else ""),
        ]
        lines.append("".join(cells_text).rstrip())
    lines.append("")
    for goal, words in GOALS.items():
        missed = len(found["missed"][goal])
        lines.append(f"{words}: " + (f"missed in {missed} of {len(found['cells'])} cells" if missed else "reached"))
    if found["missing"]:
        lines.append(f"{found['missing']} pieces of work are not done, or failed")
    if found["methods"]:
        lines += ["", f"{'where it can be known':34}{'AUROC':>8}{'worst':>8}{'return':>8}{'worst':>8}{'s':>8}"]
    for method in found["methods"]:
        scores = [number(method[score], ".3f", of) for score in ("auroc", "normalised") for of in ("mean", "worst")]
        lines.append(f"{method['method']:34}{''.join(f'{score:>8}' for score in scores)}{method['seconds']:8.2f}")
    return "\n".join(lines)


def number(seen: Row | None, form: str, of: str = "mean") -> str:
    return "–" if seen is None else format(seen[of], form)


def interval(seen: Row | None) -> str:
    around = "" if seen is None or seen["low"] is None else f" ({seen['low']:.2f}, {seen['high']:.2f})"
    return number(seen, ".3f") + around


def heat_map(cells: list[Row], path: Path) -> Any:
    """Three panels, a row for each environment and share, a column for each kind; the darker the worse."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    kinds = [kind for kind in KINDS if any(cell["kind"] == kind for cell in cells)]
    rows = list(dict.fromkeys((cell["env"], cell["share"]) for cell in cells))
    # A Figure of our own, not pyplot's: the caller's backend and open figures are left alone.
    figure = Figure(figsize=(3 + 2.0 * len(kinds), 1.7 + 0.4 * len(rows)), layout="constrained")
    for ax, (goal, name, form, best, worst) in zip(figure.subplots(1, 3, sharey=True), PANELS, strict=True):
        badness = np.full((len(rows), len(kinds)), np.nan)
        for cell in cells:
            i, j = rows.index((cell["env"], cell["share"])), kinds.index(cell["kind"])
            if cell[name] is not None:
                badness[i, j] = np.clip((cell[name]["mean"] - best) / (worst - best), 0, 1)
            text, guessed = number(cell[name], form), cell["unlabelled_draws"] - cell["ambiguous"]
            wrong_guess = goal == "verdicts" and "ambiguous" in cell["missed"]
            ax.text(
                j,
                i,
                f"{text}\n{guessed} guessed" if wrong_guess else text,
                ha="center",
                va="center",
                fontsize=7,
                color="white" if badness[i, j] > 0.6 else "black",
            )
            if wrong_guess or goal in cell["missed"]:
                frame = Rectangle((j - 0.45, i - 0.43), 0.9, 0.86, fill=False, edgecolor="#b00020", linewidth=1.5)
                ax.add_patch(frame)
        ax.imshow(badness, cmap="YlOrBr", vmin=0, vmax=1, aspect="auto")
        starred = [f"{kind}*" if any(c["unknowable"] for c in cells if c["kind"] == kind) else kind for kind in kinds]
        ax.set_xticks(range(len(kinds)), starred, rotation=35, ha="right", rotation_mode="anchor")
        ax.set_yticks(range(len(rows)), [f"{env}, {share} % bad" for env, share in rows])
        ax.tick_params(length=0, labelsize=8)
        ax.spines[:].set_visible(False)
        ax.set_title(f"Goal: {GOALS[goal]}", fontsize=9)
    figure.supxlabel(
        "Means over draws; framed where the goal is missed; * with one label of each sort from a share of one half",
        fontsize=8,
    )
    figure.savefig(path, dpi=130)
    return figure
