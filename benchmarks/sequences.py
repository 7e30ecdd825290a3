"""Are demonstrations of other kinds ranked as well as by someone who knows their kind? Is anyone accused for nothing?

    python benchmarks/sequences.py
    python benchmarks/sequences.py --quick

Each kind of `worlds/sequences.py` is a table, read with the options of the command. "true kind" is the audit of the
same demonstrations as arrays; "without" is the table without these options. Clean tables have nobody bad: all
outliers there are wrong, and so is each verdict by labels of a coin.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Mapping
from functools import partial
from multiprocessing import Pool
from typing import Any

import numpy as np
from sklearn.metrics import roc_auc_score

import rpil
from options import asked, at_least
from provenance import line, provenance
from rpil.data.errors import DataError
from rpil.results import step_weights
from rpil.results.record import Audit
from worlds.sequences import KINDS, LAW, Table

COIN_LABELS = 8
TAKEOVERS = 0.0, 1.0, 2.0, 4.0
"""Log-odds of a step of a person, tried."""


def auroc(good: Any, scores: Any) -> float:
    """Of the good against the bad; NaN where there are not both."""
    return float(roc_auc_score(good, scores)) if 0 < np.sum(good) < len(good) else float("nan")


def without(made: Table) -> float:
    """The ranking by the table without its options; NaN where it cannot be read."""
    try:
        audit = rpil.audit(made.rows)
    except DataError:
        return float("nan")
    same = len(audit.ids) == len(made.true.is_good)
    return auroc(made.true.is_good, audit.log_odds) if same else float("nan")


def of_takeovers(made: Table, audit: Audit) -> dict[str, float]:
    """How well the weights of the steps tell good from bad ones, and how far a law that is fitted by them is from the
    true one, by the log-odds of a takeover."""
    if audit.taken_over is None:
        return {}
    found, before = {}, step_weights.OF_TAKEOVER
    demonstrations = made.true.demonstrations
    design = np.column_stack([demonstrations.observations, np.ones(demonstrations.n_steps)])
    for log_odds in TAKEOVERS:
        step_weights.OF_TAKEOVER = log_odds
        weight = step_weights.weights_of(audit)
        root = np.sqrt(weight)[:, None]
        law = np.linalg.lstsq(design * root, demonstrations.actions * root, rcond=None)[0][:, 0]
        found[f"bad steps {log_odds:g}"] = auroc(~made.bad_steps, weight)
        found[f"error of the law {log_odds:g}"] = float(np.abs(law - LAW).mean())
    step_weights.OF_TAKEOVER = before
    return found


def figures(name: str, seed: int) -> dict[str, float]:
    """Those of one kind and seed."""
    rng = np.random.default_rng([36, seed])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made, clean = KINDS[name](seed), KINDS[name](seed, clean=True)
        audit, calm = rpil.audit(made.rows, **made.options), rpil.audit(clean.rows, **clean.options)
        true = rpil.audit(made.true.demonstrations)
        some = rng.permutation(len(calm.ids))[:COIN_LABELS]
        coins = calm.answered({calm.ids[m]: "good" if rng.random() < 0.5 else "bad" for m in some.tolist()})
        verdicts = [verdict for m, verdict in enumerate(coins.verdicts) if m not in some]
        good = made.true.is_good == 1
        return {
            "with": auroc(good, audit.log_odds),
            "true kind": auroc(good, true.log_odds),
            "without": without(made),
            "outliers that are good": sum(v == "outlier" and g for v, g in zip(audit.verdicts, good, strict=True)),
            "outliers that are bad": sum(v == "outlier" and not g for v, g in zip(audit.verdicts, good, strict=True)),
            "bad": float((~good).sum()),
            "outliers of clean": calm.verdicts.count("outlier"),
            "verdicts by coins": len(verdicts) - verdicts.count("open"),
            "clean": float(len(calm.ids)),
            **of_takeovers(made, audit),
        }


def row(name: str, found: list[Mapping[str, float]]) -> str:
    """Means over seeds of rankings, sums of verdicts."""
    cells = []
    for what in found[0]:
        values = np.array([one[what] for one in found])
        is_count = what in ("bad", "clean") or what.startswith(("outliers", "verdicts"))
        cells.append(f"{what} {values.sum():.0f}" if is_count else f"{what} {values.mean():.3f}")
    return f"- **{name}**: {'; '.join(cells)}"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--processes", type=at_least(1), default=2)
    parser.add_argument("--seeds", type=at_least(1), default=5)
    parser.add_argument("--only", choices=[*KINDS])
    parser.add_argument("--quick", action="store_true", help="one kind and seed: checks the script")
    options = parser.parse_args(arguments)
    names = [options.only] if options.only else [*KINDS][: 1 if options.quick else None]
    seeds = range(1 if options.quick else options.seeds)
    with Pool(options.processes) as pool:
        for name in names:
            print(row(name, pool.map(partial(figures, name), seeds, chunksize=1)), flush=True)
    print(f"\n{line(provenance(f'0 to {len(seeds) - 1}', asked(parser, options)))}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
