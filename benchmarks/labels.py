"""Which demonstrations to label: those that the audit suggests, or any? Truth answers the questions, and scores.

    python benchmarks/labels.py --data DIR --json labels.json

DIR holds NPZ files as `real.py` reads them; two small simulated data sets in which most demonstrations have their
actions flipped or shifted come beside them. A person who is asked says expert where the truth is good and adversary
where it is bad, and does not know what is in between: that question is lost. Then everything is fitted again with the
answers, and the AUROC is over the good and bad demonstrations that nobody was asked about. Which these are differs from
method to method, so the AUROC without labels *of the same ones* stands beside it.

Suggestions are made once, without labels; random ones are drawn `--draws` times, the first k of one permutation for
every k.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from options import at_least, output, write_json
from real import Truth, files, stream, truth, wins
from rpil import RPIL, Demonstrations, formats, simulate
from rpil.audit import Audit
from rpil.errors import DataError
from rpil.reproduce.provenance import provenance
from tables import table

Array = NDArray[Any]
Row = dict[str, Any]
SUGGESTED, RANDOM = "suggested", "random"
SIMULATED = {
    "mountaincar_flip": ("MountainCar-v0", "flip", 8, 12, 1),
    "acrobot_shift": ("Acrobot-v1", "shift", 8, 12, 2),
}
"""Environment, kind, how many good and bad, seed."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="where the NPZ files are")
    parser.add_argument(
        "--sets", action="append", metavar="NAME", help="may be repeated; default all with good and bad"
    )
    parser.add_argument("--labels", type=at_least(1), nargs="+", default=[1, 3, 5], metavar="K")
    parser.add_argument("--draws", type=at_least(1), default=10)
    parser.add_argument("--adversary", default="auto", help="as RPIL takes it; one by name takes half the time")
    parser.add_argument("--seed", type=at_least(0), default=0)
    parser.add_argument("--quick", action="store_true", help="one simulated data set, two draws; needs no DIR")
    parser.add_argument("--json", type=output, help="where to write all figures")
    options = parser.parse_args(arguments)
    if not (options.data or options.quick):
        parser.error("say where the NPZ files are: --data DIR.")
    with tempfile.TemporaryDirectory() as made:
        kinds = list(SIMULATED)[:1] if options.quick else list(SIMULATED)
        for name in kinds:
            simulated(Path(made) / f"{name}.npz", *SIMULATED[name])
        try:
            paths = [] if options.quick else files(options.data)
            paths = [path for path in (*files(Path(made)), *paths) if path.stem in (options.sets or [path.stem])]
            ks, draws = ((1, 3), 2) if options.quick else (options.labels, options.draws)
            result: Row = {}
            for result in measure(paths, ks, draws, options.adversary, options.seed):
                if options.json:  # after every data set: what is done is not lost
                    write_json(options.json, result)
        except DataError as error:
            parser.error(str(error))
    if not result:
        parser.error("no data set with discrete actions and both good and bad demonstrations was found.")
    print(text(result))
    return 0


def simulated(path: Path, env_id: str, kind: str, n_good: int, n_bad: int, seed: int) -> None:
    made = simulate(env_id, kind, n_good=n_good, n_bad=n_bad, seed=seed)
    known = {"is_good": made.is_good, "episode_quality": made.is_good.astype(float)}
    formats.write(path, Demonstrations.from_episodes(made.episodes), known)


def measure(paths: Iterable[Path], ks: Iterable[int], draws: int, adversary: str, seed: int) -> Iterator[Row]:
    """All figures so far, as plain numbers and text, after each data set."""
    rows: list[Row] = []
    for path in paths:
        demonstrations = formats.read(path)
        known = truth(path, demonstrations)
        if not (known.good.any() and known.bad.any() and demonstrations.is_discrete):
            continue
        begun = time.perf_counter()
        alone = fitted(demonstrations, adversary, {})
        orders = {(SUGGESTED, 0): [alone.index(name) for name in alone.suggest_labels(max(ks))]}
        rng = stream(seed, path.stem)
        orders |= {(RANDOM, draw): rng.permutation(len(demonstrations)).tolist() for draw in range(draws)}
        rows.append(
            {"set": path.stem, "how": "none", "draw": 0, "k": 0, "asked": [], **scored(alone, alone, known, [])}
        )
        for (how, draw), order in orders.items():
            for k in ks:
                asked = order[:k]
                found = fitted(demonstrations, adversary, answers(demonstrations, known, asked))
                score = scored(found, alone, known, asked)
                rows.append({"set": path.stem, "how": how, "draw": draw, "k": k, "asked": asked, **score})
        print(f"{path.stem}: {time.perf_counter() - begun:.0f} s", file=sys.stderr)
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


def answers(demonstrations: Demonstrations, known: Truth, asked: list[int]) -> dict[Any, str]:
    """What a person says of the demonstrations `asked`; nothing of those in between."""
    ids = demonstrations.ids
    said = {ids[m]: "expert" for m in asked if known.good[m]} | {ids[m]: "adversary" for m in asked if known.bad[m]}
    return {} if len(said) == len(ids) else said


def scored(found: Audit, alone: Audit, known: Truth, asked: list[int]) -> Row:
    """AUROC over who was not asked about, with labels and without; wrong verdicts among them."""
    rest = ~np.isin(np.arange(len(known.good)), asked)
    good, bad = known.good & rest, known.bad & rest
    verdicts = np.array(found.verdicts)
    wrong = int((verdicts[good] == "adversary").sum() + (verdicts[bad] == "expert").sum())
    row: Row = {"answered": int((known.good | known.bad)[asked].sum()), "wrong": wrong, "auroc": None, "without": None}
    if good.any() and bad.any():
        row |= {
            name: float(wins(audit.log_odds[good], audit.log_odds[bad]).mean())
            for name, audit in (("auroc", found), ("without", alone))
        }
    return row


def mean_over_sets(rows: list[Row], how: str, k: int) -> Row:
    """Means over data sets of the mean over draws; the standard error is over draws, data sets being what they are."""
    by_set: dict[str, list[Row]] = {}
    for row in rows:
        if row["how"] == how and row["k"] == k and row["auroc"] is not None:
            by_set.setdefault(row["set"], []).append(row)

    def mean(value: str) -> float:
        return float(np.mean([np.mean([row[value] for row in of]) for of in by_set.values()]))

    variances = [np.var([row["auroc"] for row in of], ddof=1) / len(of) for of in by_set.values() if len(of) > 1]
    return {
        "how": how,
        "k": k,
        "auroc": mean("auroc"),
        "without": mean("without"),
        "wrong": mean("wrong"),
        "se": float(np.sqrt(np.sum(variances)) / len(by_set)),
        "auroc_by_set": {name: float(np.mean([row["auroc"] for row in of])) for name, of in by_set.items()},
    }


def text(result: Row) -> str:
    """The curve as a table, a column for each data set."""
    names = list(dict.fromkeys(row["set"] for row in result["rows"]))
    none = {row["set"]: row["auroc"] for row in result["rows"] if row["how"] == "none"}
    mean = f"{np.mean(list(none.values())):.3f}"
    body = [["0", "", mean, mean, *(f"{none[name]:.3f}" for name in names)]]
    for of in result["curve"]:
        spread = f" ± {of['se']:.3f}" if of["how"] == RANDOM else ""
        each = (number(of["auroc_by_set"].get(name)) for name in names)
        body.append([str(of["k"]), of["how"], f"{of['auroc']:.3f}{spread}", f"{of['without']:.3f}", *each])
    return table(["labels", "which", "AUROC of the rest", "the same without labels", *names], body, 2)


def number(auroc: float | None) -> str:
    return "–" if auroc is None else f"{auroc:.3f}"


def markdown(result: Row) -> str:
    """The section of docs/results.md: the curve, and each data set."""
    names = list(dict.fromkeys(row["set"] for row in result["rows"]))
    at = {(of["how"], of["k"]): of for of in result["curve"]}
    none = {row["set"]: row["auroc"] for row in result["rows"] if row["how"] == "none"}
    rows = [["0", f"{np.mean(list(none.values())):.3f}", "", "", "", ""]]
    lines = []
    for k in sorted({of["k"] for of in result["curve"]}):
        ours, theirs = at[SUGGESTED, k], at[RANDOM, k]
        spread = f" ± {theirs['se']:.3f}"
        rows.append(
            [str(k), f"{theirs['without']:.3f}", f"{ours['auroc']:.3f}", f"{theirs['auroc']:.3f}{spread}"]
            + [f"{of['wrong']:.1f}" for of in (ours, theirs)]
        )
        word = "better than" if ours["auroc"] > theirs["auroc"] else "no better than"
        lines.append(f"{k} suggested: {word} {k} at random ({ours['auroc'] - theirs['auroc']:+.3f}).")
        lines += [
            f"Worse on {name.replace('_', ' ')} with {k}: {mean:.3f}, at random {theirs['auroc_by_set'][name]:.3f}."
            for name, mean in ours["auroc_by_set"].items()
            if mean < theirs["auroc_by_set"].get(name, 0.0) - 0.0005
        ]
    by_set = [
        [str(of["k"]), of["how"], *(number(of["auroc_by_set"].get(name)) for name in names)] for of in result["curve"]
    ]
    without = ["0", "", *(number(none[name]) for name in names)]
    return "\n\n".join(
        [
            "## Labels",
            f"`benchmarks/labels.py`, adversary `{result['adversary']}`: AUROC over good and bad demonstrations that "
            f"nobody was asked about, mean over {len(names)} data sets; which labels: the first k of "
            f"`audit.suggest_labels`, or k at random ({result['draws']} draws, ± one standard error over these). A "
            "question about a demonstration that is neither good nor bad stays unanswered.",
            table(
                ["labels", "none (random's rest)", "suggested", "random", "wrong verdicts, suggested", "random"],
                rows,
                0,
            ),
            table(["labels", "which", *(name.replace("_", " ") for name in names)], [without, *by_set], 2),
            "\n".join(f"- {line}" for line in lines),
        ]
    )


if __name__ == "__main__":
    raise SystemExit(main())
