"""The figures of `trust.py` as Markdown: a table for every family, the peers beside it, and the goals."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from provenance import line
from tables import bold_best, bullets, table
from trust_goals import ALL_PEERS, auroc, cell_met, place_of
from trust_scores import OURS, WITHOUT_LENGTH
from trust_worlds import FAMILIES

Row = dict[str, Any]
MET = {True: "met", False: "missed", None: "not measured"}
NOTE = (
    "Verdicts are typical/open/unlike; wrong are those of the verdicts given, with the exact 95 % interval; the "
    "other intervals are bootstrapped over demonstrations; Brier is P(typical)'s against the base rate's."
)
NAMED = 12
"""Worlds that are named where they miss a goal; of more, how many."""


def markdown(result: Row) -> str:
    """Everything that is printed."""
    families = list(dict.fromkeys(row["family"] for row in result["sets"]))
    parts = ["## Trust", NOTE]
    for family in families:
        rows = [row for row in result["sets"] if row["family"] == family]
        parts.append(GENERATED[family](rows) if family in FAMILIES else real(family, rows))
    everywhere = [row for row in result["sets"] if row["family"] not in FAMILIES]
    if everywhere:
        parts.append(peers(everywhere))
    parts += [bullets(failures(result["sets"])), "### Goals", goal_table(result["goals"]), line(result["provenance"])]
    return "\n\n".join(part for part in parts if part)


def real(family: str, rows: list[Row]) -> str:
    header = [
        "data set", "AUROC", "without length", "Spearman", "without length", "good", "bad", "wrong", "Brier", "finding",
        "CPU s",
    ]  # fmt: skip
    body = [
        [
            row["set"],
            *(score(row, method, "auroc") for method in (OURS, WITHOUT_LENGTH)),
            *(score(row, method, "spearman") for method in (OURS, WITHOUT_LENGTH)),
            counts(row, "good"),
            counts(row, "bad"),
            wrong(row),
            brier(row),
            row.get("finding", "–"),
            number(row["seconds"].get(OURS), ".1f"),
        ]
        for row in rows
    ]
    return "\n\n".join([f"### {family.capitalize()}", table(header, body)])


def score(row: Row, method: str, name: str) -> str:
    """A figure and its interval."""
    found = row["ranking"].get(method)
    if found is None or found[name] is None:
        return "–"
    low, high = found[f"{name}_ci95"]
    return f"{found[name]:.3f} ({low:.2f} to {high:.2f})"


def counts(row: Row, kind: str) -> str:
    return "/".join(map(str, row["verdicts"][kind].values())) if "verdicts" in row else "–"


def wrong(row: Row) -> str:
    if "wrong" not in row:
        return "–"
    shown = f"{row['wrong']} of {row['given']}"
    interval = row["wrong_ci95"]
    return shown if interval is None else f"{shown} ({interval[0]:.0%} to {interval[1]:.0%})"


def brier(row: Row) -> str:
    if row.get("brier") is None:
        return "–"
    low, high = row["brier_ci95"]
    return f"{row['brier']:.3f} ({low:.2f} to {high:.2f}) / {row['base_rate_brier']:.3f}"


def number(value: float | None, form: str = ".3f") -> str:
    return "–" if value is None else format(value, form)


def peers(rows: list[Row]) -> str:
    """AUROC of every method on real sets, the best of each row bold, and means over the sets that a method answers."""
    methods = [name for name in (OURS, WITHOUT_LENGTH, *ALL_PEERS) if any(name in row["ranking"] for row in rows)]
    body = []
    for row in rows:
        values = [auroc(row, name) for name in methods]
        body.append([row["set"], *bold_best([number(value) for value in values], values, 3)])
    columns = [[value for row in rows if (value := auroc(row, name)) is not None] for name in methods]
    means = [f"{np.mean(column):.3f} ({len(column)})" if column else "–" for column in columns]
    return "\n\n".join(["### AUROC beside the peers", table(["", *methods], [*body, ["mean (sets)", *means]])])


# ---- generated worlds ------------------------------------------------------------------------------------------------


def simulated(rows: list[Row]) -> str:
    """A row for each environment and share, a column for each kind, means over draws."""
    places = {place_of(row): [other for other in rows if place_of(other) == place_of(row)] for row in rows}
    kinds = list(dict.fromkeys(place.split()[1] for place in places))
    sides = list(dict.fromkeys((place.split()[0], place.split(maxsplit=2)[2]) for place in places))
    body = [[env, share, *(in_grid(places.get(f"{env} {kind} {share}")) for kind in kinds)] for env, share in sides]
    note = (
        "AUROC, and wrong of the verdicts given, over the draws; a * marks cells that cannot be known without labels, "
        "scored with one label of each sort, a † cells that miss the goal."
    )
    return "\n\n".join(["### Simulated", table(["environment", "bad", *kinds], body, 2), note])


def in_grid(draws: list[Row] | None) -> str:
    if not draws or any("verdicts" not in row for row in draws):
        return "–"
    hopeless = draws[0]["extra"]["unknowable"]
    final = [row["labelled"] for row in draws] if hopeless else draws
    mean = np.mean([row["auroc"] if hopeless else auroc(row, OURS) for row in final])
    some, of = (sum(row[name] for row in final) for name in ("wrong", "given"))
    return f"{mean:.3f}, {some} of {of}" + "*" * hopeless + "†" * (not cell_met(draws))


def styles(rows: list[Row]) -> str:
    """Means over the worlds with the same difference, number of steps and kind of actions."""
    judged = [row for row in rows if "accused" in row]
    body = []
    for key, own in grouped(judged, ("difference", "steps", "continuous")):
        aurocs = [[row[name] for row in own if row[name] is not None] for name in ("label_auroc", "oracle_auroc")]
        body.append(
            [
                f"{key[0]} %, {key[1]} steps, {'continuous' if key[2] else 'discrete'}",
                f"{np.mean([row['log_ratio'] for row in own]):.1f}",
                f"{sum(row['accused'] for row in own)} of {sum(row['size'] for row in own)}",
                f"{sum(row['groups_listed'] for row in own)} of {len(own)}",
                f"{sum(row['style_listed'] for row in own)} of {len(own)}",
                *(f"{np.mean(values):.3f}" if values else "–" for values in aurocs),
                findings(own),
            ]
        )
    header = [
        "states that differ", "nats", "accused", "groups listed", "a style listed", "AUROC, one label",
        "of the likelihood ratio", "findings",
    ]  # fmt: skip
    return "\n\n".join(["### Styles, all good", table(header, body)])


def nothing(rows: list[Row]) -> str:
    judged = [row for row in rows if "verdicts" in row]
    body = [
        [
            f"{key[0]}, {'continuous' if key[1] else 'discrete'}",
            f"{sum(row['given'] for row in own)} of {sum(row['size'] for row in own)}",
            f"{sum(row['wrong'] for row in own)}",
            f"{np.mean([row['brier'] for row in own]):.3f} / {np.mean([row['base_rate_brier'] for row in own]):.3f}",
            findings(own),
        ]
        for key, own in grouped(judged, ("kind", "continuous"))
    ]
    return "\n\n".join(["### Nothing to learn", table(["", "verdicts given", "wrong", "Brier", "findings"], body)])


def well_specified(rows: list[Row]) -> str:
    judged = [row for row in rows if "correct" in row]
    body = [
        [
            f"{key[0]} demonstrations of {key[1]} steps, {key[2]}",
            *(str(sum(row[name] for row in own)) for name in ("correct", "oracle_correct", "wrong", "oracle_wrong")),
            f"{sum(row['wrong_expected'] for row in own):.1f}",
            f"{np.mean([auroc(row, OURS) for row in own]):.3f}",
            findings(own),
        ]
        for key, own in grouped([row | {"extra": row["extra"] | {"size": row["size"]}} for row in judged], SIZES)
    ]
    header = ["", "correct", "oracle's", "wrong", "oracle's", "wrong as expected", "AUROC", "findings"]
    return "\n\n".join(["### Well-specified, the likelihood ratio known", table(header, body)])


SIZES = ("size", "steps", "adversary")
GENERATED = {"simulated": simulated, "styles": styles, "nothing": nothing, "well-specified": well_specified}


def grouped(rows: list[Row], names: Iterable[str]) -> list[tuple[tuple[Any, ...], list[Row]]]:
    """Rows that agree in some arguments of their worlds."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row["extra"][name] for name in names), []).append(row)
    return list(found.items())


def findings(rows: list[Row]) -> str:
    every = [row["finding"] for row in rows]
    return ", ".join(f"{every.count(name)} {name}" for name in dict.fromkeys(every))


# ---- what went wrong, and the goals ----------------------------------------------------------------------------------


def failures(rows: list[Row]) -> list[str]:
    """Every answer that is an error, and peers that say that they cannot."""
    lines = [f"{row['set']}, {method} failed: {how}" for row in rows for method, how in row["failed"].items()]
    said: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        for method, how in row["said"].items():
            said.setdefault((method, how), []).append(row["set"])
    return lines + [f"{method} on {named(sets)}: {how}" for (method, how), sets in said.items()]


def goal_table(goals: list[Row]) -> str:
    body = [
        [str(goal["item"]), goal["goal"], f"**{MET[goal['met']]}**", goal["figure"], named(goal["missed"])]
        for goal in goals
    ]
    return table(["", "goal", "", "figure", "missed by"], body, 5)


def named(names: list[str]) -> str:
    """The first of some names, and how many more there are."""
    shown, more = names[:NAMED], len(names) - NAMED
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")
