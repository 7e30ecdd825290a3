"""The goals of the project for the outside worlds, and what the draws say of each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .columns import OURS
from .intervals import half_widths
from .peers import ALL, ORACLE, PEERS

Row = dict[str, Any]
LEAST, WIDEST, WORTH, RETURN = -2.0, 3.0, 10.0, 12.5
"""Points of a worst cell at least, its half-width at most, what a choice is worth, and a return of Intersection."""
FOUR, EIGHT = "rpil 4 asked", "rpil 8 asked"


def goals(worlds: Mapping[str, Sequence[Row]]) -> list[tuple[str, str]]:
    """Each goal, and whether it is met, with figures."""
    draws = [draw for own in worlds.values() for draw in own]
    return [
        (f"worst cell of each use of rpil {LEAST:+.0f} or better, half-width {WIDEST:.0f}", of_worst(worlds)),
        (f"{FOUR}: {WORTH:.0f} points in half of the cells where {ORACLE} gains them", of_gains(draws)),
        (f"{EIGHT}: AUROC first, or within noise of the first peer, in five of six worlds", of_ranking(worlds)),
        (f"Intersection: a return of {RETURN}", of_return(worlds.get("intersection", []))),
    ]


def gains(draws: Sequence[Row], name: str) -> dict[str, list[float]]:
    """Points of a column less all, of the draws of each cell."""
    found = defaultdict[str, list[float]](list)
    for draw in draws:
        ours, alls = (draw["columns"].get(column, {}).get("policy") for column in (name, ALL))
        if ours is not None and alls is not None:
            found[draw["cell"]].append(ours - alls)
    return found


def short(name: str) -> str:
    return name.removeprefix("rpil ")


def of_worst(worlds: Mapping[str, Sequence[Row]]) -> str:
    """Deeds by their worst cells: those below the goal, those that meet it, and those whose interval is too wide."""
    lost, fine, unsure = [], [], []
    for name in OURS:
        worst, wide, where = 0.0, 0.0, ""
        for world, own in worlds.items():
            less = gains(own, name)
            for cell, each in less.items():
                if not where or np.mean(each) < worst:
                    worst, wide, where = float(np.mean(each)), half_widths(less, cell)[0], world
        if where and worst < LEAST:
            lost.append((worst, f"{short(name)} {worst:+.1f} ({where})"))
        elif where:
            (fine if wide is not None and wide <= WIDEST else unsure).append(short(name))
    parts = [f"missed: {', '.join(text for _, text in sorted(lost))}"] if lost else ["missed" if unsure else "met"]
    parts += [f"as asked: {', '.join(fine)}"] if fine else []
    return "; ".join(parts + ([f"interval too wide: {', '.join(unsure)}"] if unsure else []))


def of_gains(draws: Sequence[Row]) -> str:
    count, most = gained(draws, FOUR)
    others = (f"{gained(draws, name)[0]} by {short(name)}" for name in ("rpil 4 random", EIGHT, "rpil 8 random"))
    return f"{'met' if 2 * count >= most > 0 else 'missed'}: {count} of {most}; {', '.join(others)}"


def gained(draws: Sequence[Row], name: str) -> tuple[int, int]:
    """Cells in which the column gains `WORTH`, of those in which the oracle does."""
    own, most = (defaultdict[tuple[str, str], list[float]](list) for _ in range(2))
    for draw in draws:
        key = draw["world"], draw["cell"]
        for column, found in ((name, own), (ORACLE, most)):
            for each in gains([draw], column).values():
                found[key] += each
    worth = [key for key, each in most.items() if np.mean(each) >= WORTH and key in own]
    return sum(bool(np.mean(own[key]) >= WORTH) for key in worth), len(worth)


def of_ranking(worlds: Mapping[str, Sequence[Row]]) -> str:
    """AUROC of ours and of the best peer in each world; noise is the paired interval of their difference."""
    said: dict[bool, list[str]] = {True: [], False: []}
    for world, own in worlds.items():
        peers = [name for name in PEERS if name not in (ALL, ORACLE)]
        means = {name: mean for name in [EIGHT, *peers] if (mean := ranked(own, name)) is not None}
        if EIGHT not in means or len(means) < 2:
            continue
        best = max(sorted(set(means) - {EIGHT}), key=lambda name: means[name])
        less = defaultdict[str, list[float]](list)
        for draw in own:
            pair = [draw["columns"].get(name, {}).get("auroc") for name in (EIGHT, best)]
            if None not in pair:
                less[draw["cell"]].append(pair[0] - pair[1])
        wide = half_widths(less, next(iter(less)))[1] or 0.0
        fine = np.mean([np.mean(each) for each in less.values()]) + wide >= 0
        said[bool(fine)].append(f"{world} {means[EIGHT]:.2f} ({best} {means[best]:.2f})")
    count, of = len(said[True]), len(said[True] + said[False])
    others = f"; not {', '.join(said[False])}" if said[False] else ""
    return f"{'met' if count >= 5 else 'missed'}, {count} of {of}: {', '.join(said[True])}{others}"


def ranked(draws: Sequence[Row], name: str) -> float | None:
    """Mean over cells of the mean AUROC over seeds."""
    found = defaultdict[str, list[float]](list)
    for draw in draws:
        if (value := draw["columns"].get(name, {}).get("auroc")) is not None:
            found[draw["cell"]].append(value)
    return float(np.mean([np.mean(each) for each in found.values()])) if found else None


def of_return(draws: Sequence[Row]) -> str:
    if not draws:
        return "not run"
    names = [ALL, "rpil keep", "RPIL() weights", FOUR, EIGHT, "Counter-BC", ORACLE]
    means = {name: np.mean([d["columns"][name]["policy"] * d["whole"] / 100 for d in draws]) for name in names}
    said = ", ".join(f"{short(name)} {mean:.1f}" for name, mean in means.items())
    return f"{'met' if means['rpil keep'] >= RETURN else 'missed'} by keep: {said}"
