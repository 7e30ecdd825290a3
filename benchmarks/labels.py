"""Labels that the audit suggests against labels of random demonstrations; the truth answers and scores.

    python benchmarks/labels.py --data DIR --json labels.json

DIR holds NPZ files as `real.py` reads them. The answer about a demonstration is "good" where the truth is good and
"bad" where it is bad; one in between stays without an answer, and the next one is asked about, until there are k
labels. Then
everything is fitted again with these, and there are two AUROCs of good against bad. One is over all demonstrations,
those that are labelled where their labels put them: what the user has in the end. The other is over those that are not.
Which these are differs from choice to choice, so the AUROC without labels *of the same ones* stands beside it.

Suggestions are made once, without labels; random ones are drawn `--draws` times, the first k of one permutation for
every k.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npz_sets import Truth, add_data_options, check_data_options, npz_files, sets_with_both, write_simulated
from options import at_least, output, write_json
from provenance import provenance
from rpil import RPIL, Demonstrations
from rpil.audit.record import Audit
from rpil.data.errors import DataError
from scoring import auroc, plain_words, stream
from tables import table

Array = NDArray[Any]
Row = dict[str, Any]
SUGGESTED, RANDOM = "suggested", "random"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_data_options(parser, "with good and bad")
    parser.add_argument("--labels", type=at_least(1), nargs="+", default=[1, 3, 5], metavar="K")
    parser.add_argument("--draws", type=at_least(1), default=10)
    parser.add_argument("--adversary", default="auto", help="as RPIL takes it; one by name takes half the time")
    parser.add_argument("--seed", type=at_least(0), default=0)
    parser.add_argument("--quick", action="store_true", help="one simulated set, one label, one draw; needs no DIR")
    parser.add_argument("--json", type=output, help="where to write all figures")
    options = parser.parse_args(arguments)
    check_data_options(parser, options)
    with tempfile.TemporaryDirectory() as made:
        try:
            if options.quick:
                write_simulated(Path(made) / "mountaincar_flip.npz", "flip", n_good=8, n_bad=12, seed=1)
            paths = npz_files(Path(made) if options.quick else options.data, options.sets)
            ks, draws = ([1], 1) if options.quick else (options.labels, options.draws)
            result: Row = {}
            for result in measure(paths, ks, draws, options.adversary, options.seed):
                if options.json:  # after every data set: what is done is not lost
                    write_json(options.json, result)
        except DataError as error:
            parser.error(str(error))
    if not result:
        parser.error("no data set with both good and bad demonstrations was found.")
    print(text(result))
    return 0


def measure(paths: Iterable[Path], ks: Iterable[int], draws: int, adversary: str, seed: int) -> Iterator[Row]:
    """All figures so far, as plain numbers and text, after each data set."""
    rows: list[Row] = []
    for path, demonstrations, known in sets_with_both(paths):
        fits = {frozenset(): fitted(demonstrations, adversary, {})}
        alone = fits[frozenset()]
        orders = {(SUGGESTED, 0): [alone.index(name) for name in alone.suggest_labels(len(demonstrations))]}
        rng = stream(seed, path.stem)
        orders |= {(RANDOM, draw): rng.permutation(len(demonstrations)).tolist() for draw in range(draws)}
        rows.append(
            {"set": path.stem, "how": "none", "draw": 0, "k": 0, "asked": [], **scored(alone, alone, known, [])}
        )
        for (how, draw), order in orders.items():
            for k in ks:
                asked = questions(order, known, k)
                given = answers(demonstrations, known, asked)
                same = frozenset(given.items())
                if same not in fits:
                    fits[same] = fitted(demonstrations, adversary, given)
                score = scored(fits[same], alone, known, asked)
                rows.append({"set": path.stem, "how": how, "draw": draw, "k": k, "asked": asked, **score})
        yield {
            "provenance": provenance(seed),
            "adversary": adversary,
            "draws": draws,
            "rows": rows,
            "curve": [mean_over_sets(rows, how, k) for k in ks for how in (SUGGESTED, RANDOM)],
        }


def fitted(demonstrations: Demonstrations, adversary: str, labels: dict[Any, str]) -> Audit:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # ambiguity is what labels are for
        return RPIL(adversary=adversary).fit(demonstrations, labels=labels or None).audit_


def questions(order: list[int], known: Truth, k: int) -> list[int]:
    """The demonstrations that are asked about in this `order` until `k` questions are answered."""
    answered = np.cumsum((known.good | known.bad)[order])
    return order[: int(np.searchsorted(answered, k)) + 1]


def answers(demonstrations: Demonstrations, known: Truth, asked: list[int]) -> dict[Any, str]:
    """Labels of the demonstrations `asked`, without those in between."""
    ids = demonstrations.ids
    found = {ids[m]: "good" for m in asked if known.good[m]} | {ids[m]: "bad" for m in asked if known.bad[m]}
    return {} if len(found) == len(ids) else found


def scored(found: Audit, alone: Audit, known: Truth, asked: list[int]) -> Row:
    """AUROC over all, and over those without a label, with labels and without; wrong verdicts among these."""
    rest = ~np.isin(np.arange(len(known.good)), asked)
    good, bad = known.good & rest, known.bad & rest
    verdicts = np.array(plain_words(found.verdicts))
    wrong = int((verdicts[good] == "unlike").sum() + (verdicts[bad] == "typical").sum())
    row: Row = {"questions": len(asked), "wrong": wrong, "auroc": None, "without": None}
    answered = np.where(rest, found.log_odds, np.where(known.good, np.inf, -np.inf))
    row["all"] = auroc(answered[known.good], answered[known.bad])
    if good.any() and bad.any():
        row["auroc"] = auroc(found.log_odds[good], found.log_odds[bad])
        row["without"] = auroc(alone.log_odds[good], alone.log_odds[bad])
    return row


def mean_over_sets(rows: list[Row], how: str, k: int) -> Row:
    """Means over data sets of the mean over draws; the standard error is over draws, data sets being what they are.

    A draw in which all good or all bad demonstrations have a label has no AUROC of the rest.
    """
    mine = [row for row in rows if row["how"] == how and row["k"] == k]

    def by_set(value: str) -> dict[str, list[float]]:
        found: dict[str, list[float]] = {}
        for row in mine:
            if row[value] is not None:
                found.setdefault(row["set"], []).append(row[value])
        return found

    def mean(value: str) -> float | None:
        return float(np.mean([np.mean(of) for of in by_set(value).values()])) if by_set(value) else None

    def error(value: str) -> float | None:
        variances = [np.var(of, ddof=1) / len(of) for of in by_set(value).values() if len(of) > 1]
        return float(np.sqrt(np.sum(variances)) / len(by_set(value))) if by_set(value) else None

    return {
        "how": how,
        "k": k,
        **{value: mean(value) for value in ("all", "auroc", "without", "wrong", "questions")},
        "se": {value: error(value) for value in ("all", "auroc")},
        "by_set": {
            value: {name: float(np.mean(of)) for name, of in by_set(value).items()}
            for value in ("all", "auroc", "without")
        },
    }


MEASURES = {"all": "all, labels counted", "auroc": "the rest"}


def text(result: Row) -> str:
    """The curve as a table, a column for each data set."""
    names, body = curve(result)
    return table(["labels", "which", *MEASURES.values(), "the same without labels", *names], body, 2)


def curve(result: Row) -> tuple[list[str], list[list[str]]]:
    """Names of the data sets, and the rows of the table: means with their standard errors, then each set's AUROC of
    all."""
    names = list(dict.fromkeys(row["set"] for row in result["rows"]))
    none = {row["set"]: row["all"] for row in result["rows"] if row["how"] == "none"}
    mean = f"{np.mean(list(none.values())):.3f}"
    body = [["0", "", mean, mean, mean, *(f"{none[name]:.3f}" for name in names)]]
    for of in result["curve"]:
        spread = {value: f" ± {number(of['se'][value])}" if of["how"] == RANDOM else "" for value in MEASURES}
        means = [f"{number(of[value])}{spread[value]}" for value in MEASURES]
        each = (number(of["by_set"]["all"].get(name)) for name in names)
        body.append([str(of["k"]), of["how"], *means, f"{of['without']:.3f}", *each])
    return names, body


def number(auroc: float | None) -> str:
    return "–" if auroc is None else f"{auroc:.3f}"


def markdown(result: Row) -> str:
    """The section of docs/results.md: the curve, and each data set."""
    names, body = curve(result)
    at = {(of["how"], of["k"]): of for of in result["curve"]}
    lines = []
    for k in sorted({of["k"] for of in result["curve"]}):
        ours, theirs = at[SUGGESTED, k], at[RANDOM, k]
        for value, meaning in MEASURES.items():
            by, se = ours[value] - theirs[value], theirs["se"][value]
            word = "better than" if by > se else "worse than" if by < -se else "no different from"
            lines.append(f"{k} suggested, AUROC of {meaning}: {word} {k} at random ({by:+.3f} ± {se:.3f}).")
        lines += [
            f"Worse on {name.replace('_', ' ')} with {k}: {mean:.3f}, at random {theirs['by_set']['all'][name]:.3f}."
            for name, mean in ours["by_set"]["all"].items()
            if mean < theirs["by_set"]["all"].get(name, 0.0) - 0.0005
        ]
        lines.append(
            f"Wrong verdicts on the rest with {k}: {ours['wrong']:.1f}, at random {theirs['wrong']:.1f}; questions "
            f"until so many were answered: {ours['questions']:.1f}, at random {theirs['questions']:.1f}."
        )
    headings = ["labels", "which", *MEASURES.values(), "these without labels"]
    shown = len(headings)
    return "\n\n".join(
        [
            "## Labels",
            f"`benchmarks/labels.py`, adversary `{result['adversary']}`: AUROC of good against bad demonstrations, "
            f"mean over {len(names)} data sets. The labels are the first k of `audit.suggest_labels`, or k at random "
            f"({result['draws']} draws, ± one standard error over these). A question about a demonstration that is "
            "neither good nor bad stays unanswered, and the next one is asked.",
            table(headings, [row[:shown] for row in body], 2),
            "AUROC of all demonstrations of each data set, labels counted:",
            table(
                ["labels", "which", *(name.replace("_", " ") for name in names)],
                [row[:2] + row[shown:] for row in body],
                2,
            ),
            "\n".join(f"- {line}" for line in lines),
        ]
    )


if __name__ == "__main__":
    raise SystemExit(main())
