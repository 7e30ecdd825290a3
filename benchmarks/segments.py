"""Are the acts that should not have been found, where they are known row by row?

    python benchmarks/ocbench_episodes.py FOLDER      # once, where the package ocbench is installed
    python benchmarks/segments.py --ocbench FOLDER

AUROC is of rows, whether they are of a wrong act, by the score of their segment, and of demonstrations, whether they
hold one, by `shortfall`. Two marked segments are a good and a bad act by the truth, drawn at random;
their rows do not count.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ocbench_episodes import P_MISTAKE, SEEDS, TASKS
from options import at_least, output
from provenance import line, provenance
from rpil.data.demonstrations import Demonstrations
from rpil.numerics.regression import mean_ranks
from rpil.segments.find import find_segments
from rpil.segments.ranges import KINDS, Segments
from tables import table
from worlds import Array
from worlds.tidying import CLEAN, PLANTED, tidied

Row = dict[str, Any]
NOISE = (0.0, 0.004)
"""Of the sensors of the plane, whose side is 1."""


def shortfall(segments: Segments, n: int) -> Array:
    """How far the segments of each of `n` demonstrations lie below the median one, as a negative sum."""
    known = np.isfinite(segments.score)
    below = np.minimum(segments.score[known] - np.median(segments.score[known]), 0.0) if known.any() else None
    return np.bincount(segments.demonstration[known], below, n).astype(float)


def auroc(score: Array, bad: Array) -> float:
    """The probability that a bad one has the lower score, ties half; NaN without both sides."""
    n, ranks = int(bad.sum()), mean_ranks(-score)
    if n in (0, len(bad)):
        return float("nan")
    return float((ranks[bad].sum() - n * (n + 1) / 2) / (n * (len(bad) - n)))


def of_rows(segments: Segments) -> Array:
    """The score of each row; where nothing is known, the median."""
    lengths, scores = segments.end - segments.start, segments.score
    known = np.isfinite(scores)
    return np.repeat(np.where(known, scores, np.median(scores[known]) if known.any() else 0.0), lengths)


def drawn_marks(found: Segments, share: Array, rng: np.random.Generator) -> tuple[list[Any], Array]:
    """A good and a bad act by the truth, which is the share of bad rows of each segment, as labels; and their rows."""
    is_act = found.kind != KINDS.index("idle")
    chosen = [int(rng.choice(np.flatnonzero(is_act & side))) for side in (share < 0.5, share > 0.5)]
    labels = [
        (int(found.demonstration[k]), int(found.start[k]), int(found.end[k]), good)
        for k, good in zip(chosen, (True, False), strict=True)
    ]
    return labels, np.repeat(np.isin(np.arange(len(share)), chosen), found.end - found.start)


def measured(
    name: str, made: Demonstrations, bad: Array, draws: int, takeover: Array | None = None, pause: Array | None = None
) -> Row:
    """All figures of one set."""
    found = find_segments(made, takeover=takeover)
    first = made.offsets[found.demonstration] + found.start
    total = np.append(0, np.cumsum(bad))
    share = (total[first + found.end - found.start] - total[first]) / (found.end - found.start)
    is_bad = np.array([bad[a:b].any() for a, b in pairwise(made.offsets)])
    named = np.array([reason != "" for reason in found.reason])
    row = {
        "set": name,
        "rows": auroc(of_rows(found), bad),
        "demonstrations": auroc(shortfall(found, len(made)), is_bad),
        "length": auroc(-made.lengths.astype(float), is_bad),
        "segments": len(named),
        "named": int(named.sum()),
        "right": int((named & (share > 0.5)).sum()),
        "bad": int((share > 0.5).sum()),
    }
    if bad.any():
        marked = []
        for draw in range(draws):
            labels, own = drawn_marks(found, share, np.random.default_rng([draw, len(bad)]))
            scores = of_rows(find_segments(made, takeover=takeover, labels=labels))
            marked.append(auroc(scores[~own], bad[~own]))
        row["two marked"] = float(np.mean(marked))
    if pause is not None:
        idle = np.repeat(found.kind == KINDS.index("idle"), found.end - found.start)
        row |= {"idle found": float(idle[pause].mean()), "idle wrong": float(idle[~pause].mean())}
    return row


def of_ocbench(folder: Path, seeds: range, draws: int) -> Iterator[Row]:
    """Figures of each set of episodes in a folder."""
    for task in TASKS:
        for p_mistake in P_MISTAKE:
            for seed in seeds:
                path = folder / f"{task}_{p_mistake:g}_{seed}.npz"
                if not path.exists():
                    print(f"{path.name} is missing; benchmarks/ocbench_episodes.py makes it", file=sys.stderr)
                    continue
                with np.load(path) as arrays:
                    data = {name: arrays[name] for name in arrays}
                made = Demonstrations(
                    data["observations"].astype(float), data["actions"].astype(float), data["offsets"]
                )
                bad = np.zeros(made.n_steps, dtype=bool)
                for m, start, end, is_mistake in data["acts"].tolist():
                    bad[made.offsets[m] + start : made.offsets[m] + end] = is_mistake
                yield measured(f"{task}, {p_mistake:g}", made, bad, draws)


def of_planes(seeds: range, n: int, draws: int) -> Iterator[Row]:
    """Figures of each family of the plane."""
    for family in (*PLANTED, *CLEAN):
        for noise in NOISE:
            for seed in seeds:
                made = tidied(family, n, seed, noise)
                takeover = made.takeover if made.takeover.any() else None
                pause = made.pause if made.pause.any() else None
                yield measured(family, made.demonstrations, made.bad, draws, takeover, pause)


def report(rows: list[Row]) -> str:
    """The means of each family, and how many segments were named."""
    names, columns = dict.fromkeys(row["set"] for row in rows), ("rows", "two marked", "demonstrations", "length")
    lines, extra = [], []
    for name in names:
        own = [row for row in rows if row["set"] == name]
        means = [np.mean([row.get(column, np.nan) for row in own]) for column in columns]
        counts = {key: sum(row[key] for row in own) for key in ("named", "right", "bad", "segments")}
        cells = [f"{mean:.3f}" if np.isfinite(mean) else "" for mean in means]
        lines.append([name, *cells, *map(str, counts.values())])
        if "idle found" in own[0]:
            idle = [np.mean([row[key] for row in own]) for key in ("idle found", "idle wrong")]
            extra.append(f"{name}: idle rows found {idle[0]:.3f}, others called idle {idle[1]:.4f}")
    header = ["", "rows", "rows, two marked", "demonstrations", "by length", "named", "right", "bad", "segments"]
    return "\n".join([table(header, lines), "", *extra])


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ocbench", type=Path, metavar="FOLDER", help="of benchmarks/ocbench_episodes.py")
    parser.add_argument("--demonstrations", type=at_least(10), default=40, help="of each set of a plane")
    parser.add_argument("--draws", type=at_least(1), default=5, help="of two marked segments")
    parser.add_argument("--json", type=output, metavar="OUT", help="also write every row")
    parser.add_argument("--quick", action="store_true", help="one seed: checks the script")
    options = parser.parse_args(arguments)
    seeds, draws = (range(1), 1) if options.quick else (SEEDS, options.draws)
    rows = list(of_ocbench(options.ocbench, seeds, draws)) if options.ocbench else []
    rows += of_planes(seeds, options.demonstrations, draws)
    origin = provenance(f"0 to {seeds[-1]}")
    print(report(rows), line(origin), sep="\n")
    if options.json:
        options.json.write_text(json.dumps({"provenance": origin, "rows": rows}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
