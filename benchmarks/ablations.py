"""What each mechanism of the judge is worth: the judge without it, on every family of data.

    python benchmarks/ablations.py --data DIR --json FILE --processes 2    # what is finished is not done again
    python benchmarks/ablations.py --quick

DIR holds NPZ files as for trust.py. Printed are, for every variant and family, the mean AUROC, wrong among
the verdicts given, and the share of demonstrations with a verdict. At the end every family is left out once: which
variant is the best on the other families (1 - AUROC plus the share of wrong verdicts), and what it reaches on the
family that was left out.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy; worker processes inherit it

import numpy as np

from options import at_least, counted, output
from provenance import provenance
from rpil import Settings
from rpil.data.files import replacing
from rpil.estimators.rpil import RPIL
from rpil.inference import claims, groups, rivals, scores, trimming
from rpil.inference.settings import GroupSettings, HeldOutSettings, JudgeSettings, TrimmingSettings
from rpil.numerics.parallel import in_processes
from scoring import auroc, plain_words
from tables import table
from trust_data import data_cells
from trust_worlds import Cell, cells

Array = Any
Row = dict[str, Any]
DEFAULT = "the default"
QUICK = ("simulated MountainCar-v0 noisy 50 % 1000", "simulated MountainCar-v0 flip 75 % 1000")
DIFFERENCE = 0.03
"""Of loss, below which two variants are alike."""


def _normal(score: Array, variance: Array) -> float:
    """One group as a normal distribution, without skew."""
    total = max(float(score.var()), 1e-300)
    spread = np.maximum(total - variance, 1e-3 * total) + variance
    return float((-0.5 * np.log(2 * np.pi * spread) - 0.5 * (score - score.mean()) ** 2 / spread).sum())


def _first_fit(scoring: scores.Scoring, _: Array) -> trimming.TrimmedFit:
    """The fit to the first share, whatever the upper group."""
    everybody, settings = np.ones(scoring.data.n_demonstrations, dtype=bool), TrimmingSettings()
    return trimming.fit_trimmed(
        scoring.data, scoring.model, everybody, scoring.ridge, settings.share, settings.max_iter
    )


def _no_rival(*given: Any) -> rivals.Lower:
    """The lower group, which counts as none with a policy of its own."""
    return replace(rivals.look_below(*given), is_rival=False)


def _trimming(**changed: Any) -> Settings:
    return Settings(judge=JudgeSettings(trimming=TrimmingSettings(**changed)))


def _groups(**changed: Any) -> Settings:
    return Settings(judge=JudgeSettings(groups=GroupSettings(**changed)))


def _held_out(**changed: Any) -> Settings:
    return Settings(judge=JudgeSettings(held_out=HeldOutSettings(**changed)))


def _folds(n: int) -> Settings:
    return _held_out(max_folds_discrete=n, max_folds_continuous=n)


@dataclass(frozen=True)
class Variant:
    """`RPIL` with other settings, or with a function replaced: module, name, function."""

    settings: Settings = Settings()
    function: tuple[Any, str, Any] | None = None


VARIANTS: dict[str, Variant] = {
    DEFAULT: Variant(),
    "all demonstrations teach": Variant(_trimming(share=1.0)),
    "30 % teach": Variant(_trimming(share=0.3)),
    "80 % teach": Variant(_trimming(share=0.8)),
    "the upper group does not teach again": Variant(function=(scores.Scoring, "fit_group", _first_fit)),
    "one ridge, 1e-4": Variant(_held_out(ridges=(1e-4,))),
    "raw features": Variant(Settings(judge_features="raw")),
    "steps are independent": Variant(
        function=(scores, "effective_steps", lambda covariances, lengths: lengths.astype(float))
    ),
    "error bars as they are (c = 1)": Variant(_groups(noise_shares=(1.0,))),
    "one group is normal": Variant(function=(groups, "one_group", _normal)),
    "no prior on the spread of a group": Variant(_groups(prior_spread=1e-6)),
    "two groups may have one centre": Variant(_groups(min_distance=0.0)),
    "no odd experts": Variant(_groups(tail=1e-12)),
    "no rivals": Variant(function=(claims, "look_below", _no_rival)),
    "one dealing of the folds": Variant(function=(scores.Scoring, "dealt_again", lambda *_: None)),
    "ranks are worth nothing": Variant(_groups(rank_correlation=0.0)),
    "ten folds": Variant(_folds(10)),
    "five folds": Variant(_folds(5)),
}


@contextlib.contextmanager
def replaced(variant: Variant) -> Iterator[None]:
    """The library with the function of a variant, for a while."""
    if variant.function is None:
        yield
        return
    module, name, function = variant.function
    before = getattr(module, name)
    setattr(module, name, function)
    try:
        yield
    finally:
        setattr(module, name, before)


def measure(variant: str, cell: Cell) -> Row:
    """AUROC and verdicts of a variant on one set."""
    world = cell.make()
    with replaced(VARIANTS[variant]), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        audit = RPIL(settings=VARIANTS[variant].settings).fit(world.demonstrations).audit_
    good, verdicts = np.asarray(world.is_good), np.array(plain_words(audit.verdicts))
    wrong = int(((good == 1) & (verdicts == "unlike")).sum() + ((good == 0) & (verdicts == "typical")).sum())
    known = good >= 0
    both = len(np.unique(good[known])) == 2
    return {
        "family": world.family,
        "auroc": auroc(audit.log_odds[good == 1], audit.log_odds[good == 0]) if both else None,
        "wrong": wrong,
        "given": int((verdicts[known] != "open").sum()),
        "of": int(known.sum()),
        "finding": audit.finding,
    }


def chosen_cells(data: Path | None, quick: bool) -> dict[str, Cell]:
    """Every data set, and the first draw of the generated worlds with K actions."""
    if quick:
        everything = cells()
        return {name: everything[name] for name in QUICK}
    families = ("simulated", "styles", "nothing")
    generated = {name: cell for name, cell in cells(families).items() if name.split()[-1] in ("0", "1000")}
    generated = {name: cell for name, cell in generated.items() if "ontinuous" not in name and "Pendulum" not in name}
    return (data_cells(data)[0] if data else {}) | generated


def summary(rows: dict[str, Row]) -> Row:
    """Means over the sets of one variant."""
    aurocs = [row["auroc"] for row in rows.values() if row["auroc"] is not None]
    wrong, given, of = (sum(row[name] for row in rows.values()) for name in ("wrong", "given", "of"))
    shares = [row["wrong"] / max(row["given"], 1) for row in rows.values()]
    auroc = float(np.mean(aurocs)) if aurocs else None
    return {
        "auroc": auroc,
        "wrong": wrong,
        "given": given,
        "of": of,
        "loss": (0.0 if auroc is None else 1 - auroc) + (float(np.mean(shares)) if shares else 0.0),
    }


def markdown(result: Row) -> str:
    """Tables of all variants, and of what is chosen where a family is left out."""
    results: dict[str, dict[str, Row]] = result["results"]
    families = sorted({row["family"] for rows in results.values() for row in rows.values()})

    def of(variant: str, keep: Callable[[str], bool]) -> Row:
        return summary({name: row for name, row in results[variant].items() if keep(row["family"])})

    head = ["variant", *families]
    body = []
    for variant in results:
        found = [of(variant, lambda family, f=f: family == f) for f in families]
        body.append([variant, *(_cell(row) for row in found)])
    text = "## Ablations\n\nAUROC; wrong of the verdicts given; share with a verdict.\n\n" + table(head, body)
    left_out = []
    for family in families:
        losses = {variant: of(variant, lambda f, family=family: f != family)["loss"] for variant in results}
        best = min(losses, key=losses.__getitem__)
        if losses[DEFAULT] - losses[best] < DIFFERENCE:
            best = DEFAULT
        here, default = (of(variant, lambda f, family=family: f == family) for variant in (best, DEFAULT))
        left_out.append([family, best, f"{here['loss']:.3f}", f"{default['loss']:.3f}"])
    text += "\n\nChosen on the other families (loss: 1 - AUROC + share of wrong verdicts; differences below "
    text += f"{DIFFERENCE} are noise and the default stays).\n\n"
    return text + table(["left out", "chosen", "its loss there", "loss of the default there"], left_out)


def _cell(row: Row) -> str:
    auroc = "-" if row["auroc"] is None else f"{row['auroc']:.3f}"
    return f"{auroc}; {row['wrong']}/{row['given']}; {row['given'] / max(row['of'], 1):.2f}"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="where NPZ files are; default: generated worlds alone")
    parser.add_argument("--json", type=output, metavar="FILE", help="where every answer is kept")
    parser.add_argument("--processes", type=at_least(1), default=1)
    parser.add_argument("--quick", action="store_true", help="two small worlds")
    options = parser.parse_args(arguments)
    found = chosen_cells(options.data, options.quick)
    results: dict[str, dict[str, Row]] = {variant: {} for variant in VARIANTS}
    if options.json and Path(options.json).exists():
        results |= json.loads(Path(options.json).read_text())["results"]
    jobs = [(v, cell) for v in VARIANTS for name, cell in found.items() if name not in results[v]]
    names = [(v, name) for v in VARIANTS for name in found if name not in results[v]]
    rows = counted(in_processes(measure, jobs, options.processes), len(jobs), "cells of the table")
    for (variant, name), row in zip(names, rows, strict=True):
        results[variant][name] = row
        if options.json:
            with replacing(options.json) as temporary:
                Path(temporary).write_text(json.dumps({"provenance": provenance(0), "results": results}))
    print(markdown({"results": results}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
