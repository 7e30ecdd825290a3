"""The goals of R-PIL on real demonstrations, and whether they are reached."""

from __future__ import annotations

from typing import Any

from real_report import OURS

GOAL = 0.90
"""Mean AUROC over the discrete data sets."""

AUROC_GOALS = {"rilco_hopper_mix": 0.95, "rilco_halfcheetah_mix": 0.95, "vild_lunarlander": 0.90}
"""Of ours, on data sets with continuous actions."""

NEAR = 0.03
"""R^2 by which training on what ours kept may be worse than on the truly good, where actions are continuous."""

Row = dict[str, Any]


def goal(means: Row) -> Row:
    """Ours must reach `GOAL`, and be above every other's mean."""
    known = {method: of["mean"] for method, of in means.items() if of["mean"] is not None}
    ours = known.pop(OURS, None)
    best = max(known, key=known.__getitem__, default=None)
    reached = ours is not None and ours >= GOAL and (best is None or ours > known[best])
    return {"ours": ours, "asked": GOAL, "best_peer": best, "best_peer_mean": known.get(best), "reached": reached}


def continuous_goals(sets: Row, ranked: list[Row], held_out: list[Row]) -> list[Row]:
    """What is asked of ours where actions are continuous; None where it was not measured, which is not reached."""
    aurocs = {row["set"]: row["auroc"] for row in ranked if row["method"] == OURS}
    predicted = {(row["set"], row["trained_on"]): row["mean"] for row in held_out}
    aims = []
    for name in (name for name, of in sets.items() if not of["discrete"]):
        if name in AUROC_GOALS:
            aims.append(aim(name, "AUROC", aurocs.get(name), AUROC_GOALS[name]))
        best = predicted.get((name, "good"))
        aims.append(aim(name, "R²", predicted.get((name, "kept")), None if best is None else best - NEAR))
    return aims


def aim(name: str, measure: str, ours: float | None, asked: float | None) -> Row:
    """One goal of ours on one data set, up to rounding."""
    reached = ours is not None and asked is not None and ours >= asked - 1e-9
    return {"set": name, "measure": measure, "ours": ours, "asked": asked, "reached": reached}
