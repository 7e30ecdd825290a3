"""Trust with `demonstrators=` and without, for whole demonstrations and for short pieces of them.

    python benchmarks/demonstrators.py --data DIR --json demonstrators.json

DIR holds NPZ files as `real.py` reads them. Sets count that name the demonstrators (`demonstrator_ids`), at least one
of whom gave two demonstrations. Each set is judged whole, and with some consecutive steps of each demonstration,
beginning at random: there the other demonstrations of the same person should help. Both fits see the same steps. A
simulated set is added: five people, two of them good, who give four demonstrations each.

AUROC is good against bad. Its interval is bootstrapped over *demonstrators*, since those of one person are good or bad
together, and over demonstrations within them.
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

from npz_sets import add_data_options, check_data_options, npz_files, sets_with_both, write_simulated
from options import at_least, output, write_json
from provenance import provenance
from rpil import RPIL, Demonstrations
from rpil.data.errors import DataError
from rpil.data.formats import read_demonstrators
from scoring import interval, pair_wins, stream
from tables import table

Array = NDArray[Any]
Row = dict[str, Any]
COLUMN = "demonstrator_ids"
WHOLE = 0
N_RESAMPLES = 1000


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_data_options(parser, "that name the demonstrators")
    parser.add_argument("--steps", type=at_least(1), default=10, help="that are left of a demonstration cut short")
    parser.add_argument("--draws", type=at_least(1), default=5, help="of the place where they are cut")
    parser.add_argument("--adversary", default="auto", help="as RPIL takes it; one by name takes half the time")
    parser.add_argument("--seed", type=at_least(0), default=0)
    parser.add_argument("--quick", action="store_true", help="the simulated set, one draw; needs no DIR")
    parser.add_argument("--json", type=output, help="where to write all figures")
    options = parser.parse_args(arguments)
    check_data_options(parser, options)
    with tempfile.TemporaryDirectory() as made:
        # Two people give the expert's demonstrations; half of the actions of the other three are random.
        five_people = Path(made) / "mountaincar_five_people.npz"
        write_simulated(five_people, "noisy", 8, 12, options.seed, **{COLUMN: np.repeat(np.arange(5), 4)})
        result: Row = {}
        try:
            paths = [five_people, *([] if options.quick else npz_files(options.data))]
            paths = [path for path in paths if path.stem in (options.sets or [path.stem])]
            draws = 1 if options.quick else options.draws
            for result in measure(paths, options.steps, draws, options.adversary, options.seed):
                if options.json:  # after every data set: what is done is not lost
                    write_json(options.json, result)
        except DataError as error:
            parser.error(str(error))
    if not result:
        parser.error("no data set with good and bad demonstrations names its demonstrators.")
    print(text(result))
    return 0


def measure(paths: Iterable[Path], steps: int, draws: int, adversary: str, seed: int) -> Iterator[Row]:
    """All figures so far, after each data set."""
    rows: list[Row] = []
    for path, demonstrations, known in sets_with_both(paths):
        people = names(path, demonstrations)
        if people is None:
            continue
        rng = stream(seed, path.stem)
        versions = [(WHOLE, demonstrations)] + [(steps, cut(demonstrations, steps, rng)) for _ in range(draws)]
        scores = [(of, judged(data, adversary, None), judged(data, adversary, people)) for of, data in versions]
        for of in (WHOLE, steps):
            without, knowing = (
                [score(pair[way], known.good, known.bad, people, rng) for pair in scores if pair[0] == of]
                for way in (1, 2)
            )
            rows.append(summary(path.stem, of, without, knowing) | {"people": len(set(people))})
        yield {"provenance": provenance(seed), "adversary": adversary, "steps": steps, "draws": draws, "rows": rows}


def names(path: Path, demonstrations: Demonstrations) -> list[str] | None:
    """The demonstrator of each demonstration, or None where the file names none, or only one for all or for each."""
    try:
        found = read_demonstrators(COLUMN, path)
    except DataError:
        return None
    people = [found[str(name)] for name in demonstrations.ids]
    return people if 1 < len(set(people)) < len(people) else None


def cut(demonstrations: Demonstrations, steps: int, rng: np.random.Generator) -> Demonstrations:
    """`steps` steps in a row of each demonstration, or all of one that is shorter; where from is drawn."""
    spare = np.maximum(demonstrations.lengths - steps, 0)
    first = demonstrations.offsets[:-1] + rng.integers(spare + 1)
    taken = np.concatenate(
        [np.arange(at, at + n) for at, n in zip(first, np.minimum(demonstrations.lengths, steps), strict=True)]
    )
    return Demonstrations.from_groups(
        demonstrations.observations[taken],
        demonstrations.actions[taken],
        np.asarray(demonstrations.ids)[demonstrations.groups[taken]],
    )


def judged(demonstrations: Demonstrations, adversary: str, people: list[str] | None) -> Array:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # ambiguity and convergence: the figures tell what came of it
        return RPIL(adversary=adversary).fit(demonstrations, demonstrators=people).log_odds_


def score(log_odds: Array, good: Array, bad: Array, people: list[str], rng: np.random.Generator) -> tuple[float, Array]:
    """AUROC, and its bootstrap draws: people with replacement, then the demonstrations of each."""
    won = pair_wins(log_odds[good], log_odds[bad])
    _, of = np.unique(people, return_inverse=True)
    n_people = of.max() + 1
    draws = np.empty(N_RESAMPLES)
    for i in range(N_RESAMPLES):
        chosen = np.bincount(rng.integers(n_people, size=n_people), minlength=n_people)
        weight = rng.poisson(chosen[of])  # as often as its demonstrator is drawn, then each demonstration by itself
        total = weight[good].sum() * weight[bad].sum()
        draws[i] = weight[good] @ won @ weight[bad] / total if total else np.nan
    return float(won.mean()), draws


def summary(name: str, steps: int, without: list[tuple[float, Array]], knowing: list[tuple[float, Array]]) -> Row:
    """Means over cuts, and how far they differ between cuts."""
    row: Row = {"set": name, "steps": steps or None}
    for key, scores in (("without", without), ("knowing", knowing)):
        resampled = np.concatenate([draws[~np.isnan(draws)] for _, draws in scores])
        row[key] = float(np.mean([mean for mean, _ in scores]))
        row[f"{key}_ci95"] = interval(resampled) if len(resampled) else None
        row[f"{key}_each"] = [mean for mean, _ in scores]
    row["gain"] = row["knowing"] - row["without"]
    gains = np.subtract(row["knowing_each"], row["without_each"])
    row["gain_se"] = float(gains.std(ddof=1) / np.sqrt(len(gains))) if len(gains) > 1 else None
    return row


def text(result: Row) -> str:
    """A row for each data set, whole and cut."""
    body = []
    for row in result["rows"]:
        shown = [
            f"{row[key]:.3f}" + (" ({:.2f} to {:.2f})".format(*row[f"{key}_ci95"]) if row[f"{key}_ci95"] else "")
            for key in ("without", "knowing")
        ]
        spread = "" if row["gain_se"] is None else f" ± {row['gain_se']:.3f}"
        where = [row["set"].replace("_", " "), str(row["people"]), str(row["steps"] or "all")]
        body.append([*where, *shown, f"{row['gain']:+.3f}{spread}"])
    return table(
        ["", "people", "steps of each", "AUROC, demonstrators unknown", "demonstrators known", "gain"], body, 1
    )


def markdown(result: Row) -> str:
    """The section of docs/results.md."""
    cuts = [row for row in result["rows"] if row["steps"]]
    wholes = [row for row in result["rows"] if not row["steps"]]
    lines = [
        f"{what}: {np.mean([row['without'] for row in rows]):.3f} without, "
        f"{np.mean([row['knowing'] for row in rows]):.3f} with demonstrators, over {len(rows)} data sets."
        for what, rows in (("Whole demonstrations", wholes), (f"Cut to {result['steps']} steps", cuts))
    ]
    lines += [
        f"Worse with them on {row['set'].replace('_', ' ')}, {row['steps'] or 'all'} steps: {row['gain']:+.3f}."
        for row in result["rows"]
        if row["gain"] < -0.0005
    ]
    return "\n\n".join(
        [
            "## Demonstrators",
            f"`benchmarks/demonstrators.py`, adversary `{result['adversary']}`: AUROC (95 % interval, bootstrapped "
            f"over people and what they gave) with `demonstrators=` and without; {result['steps']} steps are cut out "
            f"of each demonstration {result['draws']} times, and ± is one standard error over these.",
            text(result),
            "\n".join(f"- {line}" for line in lines),
        ]
    )


if __name__ == "__main__":
    raise SystemExit(main())
