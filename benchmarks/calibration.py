"""Calibration of P(typical), and false accusations where there is no signal.

    python benchmarks/calibration.py --draws 5 --json calibration.json

With signal: the cells of `robustness.py`, 10 good demonstrations and as many bad ones as make up a share of 50, 75 or
90 %. The expected calibration error compares P(typical), in ten bins, with the share of the good; and the interval for
the share of experts should hold the truth. Where the data cannot tell which group is good, one label of each sort is
given, and labelled demonstrations are not scored. Draws with the finding "two groups" are left out: they have no
verdicts.

Without signal: 20 demonstrations that do not differ. They all come from one policy, an expert, a random one or an
expert half of whose actions are random; or ten good and ten corrupted ones are shuffled, their actions among all steps,
or their steps among all demonstrations. "unlike" is wrong for each of them.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grid import ENVIRONMENTS, N_GOOD, SHARES, n_bad, one_label_each, unknowable
from options import at_least, output, write_json
from provenance import provenance
from rpil.audit.record import Audit
from rpil.data.demonstrations import Demonstrations
from rpil.estimators.rpil import RPIL
from rpil.simulation.corruptions import KINDS
from rpil.simulation.simulate import simulate
from tables import table

N_ALIKE, N_BINS = 20, 10
ONE_POLICY = {"all good": ("corrupted", 1), "all random": ("random", 0), "all noisy": ("noisy", 0)}
SHUFFLED = ("actions shuffled", "steps shuffled")
Array = NDArray[Any]
Row = dict[str, Any]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=at_least(1), default=5)
    parser.add_argument("--first-seed", type=at_least(0), default=700)
    parser.add_argument("--environments", nargs="+", metavar="ID", default=ENVIRONMENTS)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--shares", nargs="+", type=at_least(1, 99), metavar="PERCENT", default=SHARES)
    parser.add_argument("--quick", action="store_true", help="MountainCar, half bad, one draw")
    parser.add_argument("--json", type=output, help="where to write all figures")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    environments, shares, draws = options.environments, options.shares, options.draws
    if options.quick:
        environments, shares, draws = ENVIRONMENTS[:1], SHARES[:1], 1
    seeds = range(options.first_seed, options.first_seed + draws)
    result: Row = {}
    for result in measure(environments, options.kinds, shares, seeds):
        if options.json:  # after every environment of every draw: what is done is not lost
            write_json(options.json, {"provenance": provenance(list(seeds)), **result})
    print(text(result))
    return 0


def measure(environments: Sequence[str], kinds: Sequence[str], shares: Sequence[int], seeds: range) -> Iterator[Row]:
    """All figures so far, after each environment of each draw."""
    signal: list[Row] = []
    alike: list[Row] = []
    for seed in seeds:
        for env in environments:
            begun = time.perf_counter()
            signal += [with_signal(env, kind, share, seed) for kind in kinds for share in shares]
            alike += [without_signal(env, name, seed) for name in (*ONE_POLICY, *SHUFFLED)]
            print(f"{env}, seed {seed}: {time.perf_counter() - begun:.0f} s", file=sys.stderr, flush=True)
            yield summary(signal, alike)


def with_signal(env: str, kind: str, share: int, seed: int) -> Row:
    """Probabilities of the audit of one draw, and the truth."""
    made = simulate(env, kind, n_good=N_GOOD, n_bad=n_bad(share), seed=seed)
    labels = one_label_each(made.is_good == 1) if unknowable(kind, share) else {}
    audit = fitted(Demonstrations.from_episodes(made.episodes), labels)
    asked = np.setdiff1d(np.arange(len(made.episodes)), list(labels))
    return {
        "env": env,
        "kind": kind,
        "share": share,
        "seed": seed,
        "labelled": bool(labels),
        "ambiguous": not audit.identifiable,
        "proba": [round(float(p), 6) for p in audit.expert_proba[asked]],
        "good": made.is_good[asked].tolist(),
        "low": audit.prior.low,
        "high": audit.prior.high,
        "covered": bool(audit.prior.low <= made.is_good.mean() <= audit.prior.high),
    }


def without_signal(env: str, name: str, seed: int) -> Row:
    """How many of `N_ALIKE` demonstrations that do not differ are called unlike."""
    if name in ONE_POLICY:
        kind, kept = ONE_POLICY[name]
        made = simulate(env, kind, n_good=N_ALIKE, n_bad=N_ALIKE, seed=seed)
        demonstrations = Demonstrations.from_episodes(made.episodes).select(made.is_good == kept)
    else:
        made = simulate(env, "corrupted", n_good=N_ALIKE // 2, n_bad=N_ALIKE // 2, seed=seed)
        demonstrations = shuffled(Demonstrations.from_episodes(made.episodes), name, np.random.default_rng(seed))
    verdicts = fitted(demonstrations, {}).verdicts
    return {"env": env, "name": name, "seed": seed, "accused": verdicts.count("unlike"), "of": len(verdicts)}


def shuffled(demonstrations: Demonstrations, name: str, rng: np.random.Generator) -> Demonstrations:
    """The same numbers of steps, with the actions or the steps exchanged among all demonstrations."""
    order = rng.permutation(demonstrations.n_steps)
    steps = order if name == "steps shuffled" else np.arange(len(order))
    return Demonstrations.from_groups(
        demonstrations.observations[steps], demonstrations.actions[order], demonstrations.groups
    )


def fitted(demonstrations: Demonstrations, labels: dict[Any, str]) -> Audit:
    return RPIL().fit(demonstrations, labels=labels or None).audit_


def summary(signal: list[Row], alike: list[Row]) -> Row:
    claims = [row for row in signal if not row["ambiguous"]]
    accused: dict[str, list[int]] = {}
    for row in alike:
        accused.setdefault(row["name"], []).append(row["accused"])
    return {
        "ece": ece_of(claims),
        "ece_by": {
            by: {
                str(key): ece_of(row for row in claims if row[by] == key)
                for key in dict.fromkeys(r[by] for r in claims)
            }
            for by in ("env", "kind", "share")
        },
        "bins": bins(*pooled(claims)),
        "n_judged": sum(len(row["good"]) for row in claims),
        "n_draws": len(signal),
        "n_ambiguous": len(signal) - len(claims),
        "covered": float(np.mean([row["covered"] for row in claims])) if claims else None,
        "accused": accused,
        "n_each": N_ALIKE,
        "signal": signal,
        "alike": alike,
    }


def pooled(rows: Iterable[Row]) -> tuple[Array, Array]:
    """P(expert) and whether it was one, of all demonstrations."""
    found = list(rows)
    proba, good = ([value for row in found for value in row[name]] for name in ("proba", "good"))
    return np.array(proba, dtype=float), np.array(good, dtype=bool)


def ece_of(rows: Iterable[Row]) -> float | None:
    proba, good = pooled(rows)
    return expected_calibration_error(proba, good) if len(proba) else None


def expected_calibration_error(proba: Array, truth: Array) -> float:
    """Mean over demonstrations of how far a bin's mean probability is from its share of experts."""
    return float(sum(abs(row["proba"] - row["good"]) * row["n"] for row in bins(proba, truth)) / len(proba))


def bins(proba: Array, truth: Array) -> list[Row]:
    """Mean P(expert), share of experts and number of demonstrations in each bin that is not empty."""
    of = np.minimum((proba * N_BINS).astype(int), N_BINS - 1)
    return [
        {"proba": float(proba[of == b].mean()), "good": float(truth[of == b].mean()), "n": int((of == b).sum())}
        for b in np.unique(of)
    ]


def text(result: Row) -> str:
    counts = {name: (sum(found), result["n_each"] * len(found)) for name, found in result["accused"].items()}
    total, of = (sum(column) for column in zip(*counts.values(), strict=True))
    shown = {by: {key: f"{value:.3f}" for key, value in found.items()} for by, found in result["ece_by"].items()}
    lines = [
        f"{result['n_draws']} draws with signal, {result['n_ambiguous']} of them answered ambiguous and left out.",
    ]
    if result["ece"] is not None:
        lines += [
            f"Expected calibration error over {result['n_judged']} demonstrations: {result['ece']:.4f} (goal .05); "
            + "; ".join(", ".join(f"{key} {value}" for key, value in found.items()) for found in shown.values())
            + ".",
            f"The interval for the share of experts held the truth in {result['covered']:.0%} of draws (goal 90 %).",
        ]
    lines.append(
        f"Without signal {total} of {of} were called adversaries, {total / of:.1%} (goal 5 %): "
        + ", ".join(f"{name} {some} of {n}" for name, (some, n) in counts.items())
        + "."
    )
    rows = [[f"{row['proba']:.3f}", f"{row['good']:.3f}", str(row["n"])] for row in result["bins"]]
    return "\n".join([*lines, "", table(["P(expert)", "experts", "demonstrations"], rows, 0)])


def markdown(result: Row) -> str:
    """The section of docs/results.md."""
    accused = [[name, str(sum(found)), str(result["n_each"] * len(found))] for name, found in result["accused"].items()]
    total = sum(int(row[1]) for row in accused) / sum(int(row[2]) for row in accused)
    ece = {key: value for found in result["ece_by"].values() for key, value in found.items()}
    shown = ["–" if value is None else f"{value:.3f}" for value in ece.values()]
    rows = [[f"{row['proba']:.3f}", f"{row['good']:.3f}", str(row["n"])] for row in result["bins"]]
    goals = {
        f"expected calibration error {result['ece']:.4f}, at most .05": result["ece"] <= 0.05,
        f"the interval for the share of experts held the truth in {result['covered']:.0%} of draws, at least 90 %": (
            result["covered"] >= 0.9
        ),
        f"called adversaries without signal {total:.1%}, at most 5 %": total <= 0.05,
    }
    return "\n\n".join(
        [
            "## Calibration",
            f"`benchmarks/calibration.py`: {result['n_draws']} draws of the cells of the grid, "
            f"{result['n_judged']} demonstrations; {result['n_ambiguous']} draws were answered “ambiguous” and claim "
            "nothing. Where the data cannot tell which group is good, one label of each sort is given, and not scored.",
            "\n".join(f"- Goal {'reached' if reached else 'missed'}: {said}." for said, reached in goals.items()),
            "What P(expert) says, and how many were experts:",
            table(["P(expert), mean of a tenth", "experts", "demonstrations"], rows, 0),
            "Expected calibration error by environment, kind and share of the bad (%):",
            table(list(ece), [shown], 0),
            "Called adversaries where demonstrations do not differ, because all come from one policy, or because "
            "actions or steps were shuffled:",
            table(["", "called adversaries", "of"], accused, 1),
        ]
    )


if __name__ == "__main__":
    raise SystemExit(main())
