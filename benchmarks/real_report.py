"""What `real.py` found, for a terminal and for docs/results.md; where ours is not the best, it says so."""

from __future__ import annotations

from typing import Any

from scoring import VERDICTS
from tables import and_list, bold_best, bullets, by_column, table

OURS = "rpil"
Row = dict[str, Any]


def text(result: Row) -> str:
    """All tables for a terminal."""
    names, width = list(result["sets"]), 14
    found = {(row["method"], row["set"]): row for row in result["ranking"]}
    held = {(row["set"], row["trained_on"]): row for row in result["held_out"]}
    means = result["mean_auroc"]

    def line(name: str, cells: list[str]) -> str:
        return f"{name:28}" + "".join(f"{cell:>{width}}" for cell in cells)

    heads = [name.split("_") for name in names]
    depth = max(map(len, heads))
    upright = [[*[""] * (depth - len(head)), *head] for head in heads] + [[*[""] * (depth - 1), "mean"]]
    lines = [f"features {result['features']}, seed {result['provenance']['seeds']}", ""]
    lines += [line("", list(words)) for words in zip(*upright, strict=True)]
    lines.append("AUROC ± standard error")
    for method, mean in means.items():
        cells = [plus_minus(found.get((method, name), {}), "auroc", "auroc_se") for name in names]
        lines.append(line(f"  {method}", [*cells, plus_minus(mean, "mean", "se")]))
    lines.append("Spearman's correlation with quality")
    for method in means:
        lines.append(line(f"  {method}", [plus_minus(found.get((method, name), {}), "spearman") for name in names]))
    lines.append("Held-out good demonstrations, accuracy or R², when trained on")
    for trained_on in dict.fromkeys(row["trained_on"] for row in result["held_out"]):
        rows = [held.get((name, trained_on), {}) for name in names]
        lines.append(line(f"  {trained_on}", [plus_minus(row, "mean", digits=3) for row in rows]))
    verdicts = [f"Verdicts, {said}" for said in verdict_lines(result)]
    return "\n".join([*lines, "", *verdicts, *said_lines(result), goal_line(result), *continuous_lines(result)])


def plus_minus(row: Row, value: str, error: str | None = None, digits: int = 2) -> str:
    if row.get(value) is None:
        return "–"
    return f"{row[value]:.{digits}f}" + (f" ± {row[error]:.{digits}f}" if error else "")


def verdict_lines(result: Row) -> list[str]:
    """How many of the good and of the bad our default calls what."""
    lines = []
    for row in result["ranking"]:
        if row["method"] == OURS and row["verdicts"]:
            counts = [
                f"of {sum(of.values())} {sort} {and_list([f'{of[verdict]} {verdict}' for verdict in VERDICTS])}"
                for sort, of in row["verdicts"].items()
                if sum(of.values())
            ]
            lines.append(f"{spaced(row['set'])}: {'; '.join(counts)}.")
    return lines


def said_lines(result: Row) -> list[str]:
    """Why there is no figure, each reason once."""
    lines = []
    for said in dict.fromkeys(row["said"] for row in result["ranking"] if row["said"]):
        rows = [row for row in result["ranking"] if row["said"] == said]
        methods, sets = (list(dict.fromkeys(row[of] for row in rows)) for of in ("method", "set"))
        lines.append(f"No figure for {and_list(methods)} on {and_list(list(map(spaced, sets)))}: {said}")
    return lines


def goal_line(result: Row) -> str:
    """The goal, and whether it is reached, with figures."""
    aim = result["goal"]
    asked = f'Goal "mean AUROC >= {aim["asked"]:.2f} and above every peer\'s mean"'
    if aim["ours"] is None:
        return f"{asked}: not measured, ours or a data set is missing."
    peer = f", best peer {aim['best_peer_mean']:.3f} ({aim['best_peer']})" if aim["best_peer"] else ""
    return f"{asked}: {'reached' if aim['reached'] else 'missed'}, ours {aim['ours']:.3f}{peer}."


def continuous_lines(result: Row) -> list[str]:
    """The goals where actions are continuous, one sentence each."""
    lines = []
    for aim in result["continuous_goals"]:
        near = ", which is what training on the truly good gives, less .03" if aim["measure"] == "R²" else ""
        if aim["ours"] is None or aim["asked"] is None:
            lines.append(f"Goal for {aim['measure']} on {spaced(aim['set'])}: not measured.")
            continue
        word = "reached" if aim["reached"] else "missed"
        asked = f"{aim['measure']} on {spaced(aim['set'])} >= {aim['asked']:.3f}{near}"
        lines.append(f'Goal "{asked}": {word}, ours {aim["ours"]:.3f}.')
    return lines


def markdown(result: Row, title: str = "Real demonstrations") -> str:
    """The section of docs/results.md."""
    names = list(result["sets"])
    mixed = [name for name in names if result["sets"][name]["bad"]]
    found = {(row["method"], row["set"]): row for row in result["ranking"]}
    aurocs = {
        method: [
            *(
                (with_interval(row, "auroc"), row.get("auroc"))
                for row in (found.get((method, name), {}) for name in mixed)
            ),
            (plus_minus(mean, "mean", "se"), mean["mean"]),
        ]
        for method, mean in result["mean_auroc"].items()
    }
    spearmans = {
        method: [
            (plus_minus(row, "spearman"), row.get("spearman"))
            for row in (found.get((method, name), {}) for name in names)
        ]
        for method in result["mean_auroc"]
    }
    parts = [
        f"## {title}",
        f"`benchmarks/real.py`, features `{result['features']}` for all methods. Scores are taken as they are: higher "
        "is more trusted in every data set. RM-ENT alone gets the number of good demonstrations. Intervals "
        "(95 %) and standard errors (±) are bootstrapped over demonstrations; the best of each column is bold.",
        sets_table(result["sets"]),
        "### AUROC, good against bad",
        "Those in between are left out; the mean is over the discrete data sets.",
        by_column([*map(spaced, mixed), "mean"], aurocs),
        " ".join([goal_line(result), *said_lines(result)]),
        bullets([*behind(result, "auroc"), *ahead(result)]),
        bullets(continuous_lines(result)),
        "### Spearman's correlation with quality, all demonstrations",
        by_column(list(map(spaced, names)), spearmans),
        bullets(behind(result, "spearman")),
        "### Verdicts of our default",
        bullets(verdict_lines(result)),
        "### A policy from what was kept",
        "Good demonstrations of five held-out folds: the share of their actions that is predicted, or R² where actions "
        "are continuous, by a policy trained on all other demonstrations, on what our default kept of them, and on the "
        "good ones among them. The better of the first two is bold.",
        held_out_table(result),
        bullets(worse_kept(result)),
    ]
    return "\n\n".join(part for part in parts if part)


def spaced(name: str) -> str:
    return name.replace("_", " ")


def with_interval(row: Row, value: str, digits: int = 2) -> str:
    if row.get(value) is None:
        return "–"
    low, high = row["auroc_ci95" if value == "auroc" else "gain_ci95" if value == "gain" else "ci95"]
    return f"{row[value]:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def sets_table(sets: Row) -> str:
    rows = []
    for name, of in sets.items():
        actions = f"{of['actions']}" if of["discrete"] else f"{of['actions']} continuous"
        counts = (of["demonstrations"], of["steps"], of["observations"], actions, of["good"], of["bad"])
        rows.append([spaced(name), *(f"{size:,}" if isinstance(size, int) else size for size in counts)])
    return table(["", "demonstrations", "steps", "observations", "actions", "good", "bad"], rows)


def behind(result: Row, score: str) -> list[str]:
    """The data sets on which somebody is above us in "auroc" or "spearman"."""
    lines = []
    for name in result["sets"]:
        rows = {row["method"]: row for row in result["ranking"] if row["set"] == name and row[score] is not None}
        ours = rows.pop(OURS, None)
        above = [row for row in rows.values() if ours and row[score] > ours[score]]
        better = [f"{row['method']} {row[score]:.2f}" for row in sorted(above, key=lambda row: -row[score])]
        if ours and better:
            our = with_interval(ours, score) if score == "auroc" else plus_minus(ours, score)
            lines.append(f"Not the best on {spaced(name)}: ours {our}, {and_list(better)}.")
    return lines


def ahead(result: Row) -> list[str]:
    """The peers that ours is not ahead of beyond doubt, by the interval of the difference of means."""
    close = [
        f"{method} ({of['ours_ahead']:+.3f}, {of['ours_ahead_ci95'][0]:+.3f} to {of['ours_ahead_ci95'][1]:+.3f})"
        for method, of in result["mean_auroc"].items()
        if of["ours_ahead"] is not None and of["ours_ahead_ci95"][0] <= 0
    ]
    return [f"Ours minus theirs, mean AUROC, not surely above zero: {and_list(close)}."] if close else []


def held_out_table(result: Row) -> str:
    by_set: dict[str, dict[str, Row]] = {}
    for row in result["held_out"]:
        by_set.setdefault(row["set"], {})[row["trained_on"]] = row
    rows = []
    for name, of in by_set.items():
        first = [of.get(trained_on, {}) for trained_on in ("all", "kept")]
        pair = bold_best([with_interval(row, "mean", 3) for row in first], [row.get("mean") for row in first], 3)
        rows.append(
            [spaced(name), *pair, with_interval(of.get("good", {}), "mean", 3), with_interval(first[1], "gain", 3)]
        )
    return table(["", "all", "kept", "the truly good", "kept minus all"], rows)


def worse_kept(result: Row) -> list[str]:
    """Where a policy is no better for what was kept."""
    return [
        f"No better for keeping on {spaced(row['set'])}: {with_interval(row, 'gain', 3)} against training on all."
        for row in result["held_out"]
        if row["trained_on"] == "kept" and row["gain"] is not None and row["gain"] <= 0
    ]
