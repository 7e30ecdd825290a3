"""Does P(expert) mean what it says, and is anybody accused where there is no signal?

    python benchmarks/calibration.py --draws 3 --json calibration.json

With signal: 10 good and 10 bad demonstrations of several kinds. The expected calibration error compares P(expert), in
ten bins, with the share of the good; and the interval for the share of experts should hold the truth. Draws answered
"ambiguous" are left out: there nothing is claimed. Without signal: 20 demonstrations that all come from one policy, an
expert, a random one or an expert half of whose actions are random; "adversary" is wrong for each of them.
"""

from __future__ import annotations

import argparse
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.demonstrations import Demonstrations
from rpil.estimators import RPIL
from rpil.reproduce.provenance import provenance
from rpil.simulation import simulate

ENVIRONMENTS = ("MountainCar-v0", "Acrobot-v1", "LunarLander-v3")
SIGNAL = ("corrupted", "random", "noisy", "window", "sensor")
NO_SIGNAL = {"all good": ("corrupted", 1), "all random": ("random", 0), "all noisy": ("noisy", 0)}
N_BINS = 10
Array = NDArray[Any]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=700)
    parser.add_argument("--quick", action="store_true", help="MountainCar, one draw")
    parser.add_argument("--json", type=Path, help="where to write all figures")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    environments = ENVIRONMENTS[:1] if options.quick else ENVIRONMENTS
    seeds = range(options.first_seed, options.first_seed + (1 if options.quick else options.draws))
    result = measure(environments, seeds)
    print(text(result))
    if options.json:
        options.json.write_text(json.dumps({"provenance": provenance(seeds=list(seeds)), **result}, indent=1))
    return 0


def measure(environments: tuple[str, ...], seeds: range) -> dict[str, Any]:
    proba, truth, covered, ambiguous = [], [], [], 0
    accused: dict[str, list[int]] = {name: [] for name in NO_SIGNAL}
    for seed in seeds:
        for env in environments:
            for kind in SIGNAL:
                made = simulate(env, kind, n_good=10, n_bad=10, seed=seed)
                audit = RPIL().fit(Demonstrations.from_episodes(made.episodes)).audit_
                if not audit.identifiable:
                    ambiguous += 1
                    continue
                proba.append(audit.expert_proba)
                truth.append(made.is_good == 1)
                covered.append(audit.prior.low <= truth[-1].mean() <= audit.prior.high)
            for name, (kind, kept) in NO_SIGNAL.items():
                made = simulate(env, kind, n_good=20, n_bad=20, seed=seed)
                alike = Demonstrations.from_episodes(made.episodes).select(made.is_good == kept)
                accused[name].append(RPIL().fit(alike).audit_.verdicts.count("adversary"))
    return {
        "ece": expected_calibration_error(np.concatenate(proba), np.concatenate(truth)),
        "n_judged": int(sum(map(len, proba))),
        "n_ambiguous": ambiguous,
        "covered": float(np.mean(covered)),
        "accused": accused,
        "n_each": 20,
    }


def expected_calibration_error(proba: Array, truth: Array) -> float:
    """Mean over demonstrations of how far a bin's mean probability is from its share of experts."""
    of = np.minimum((proba * N_BINS).astype(int), N_BINS - 1)
    gaps = [abs(proba[of == b].mean() - truth[of == b].mean()) * (of == b).mean() for b in np.unique(of)]
    return float(sum(gaps))


def text(result: dict[str, Any]) -> str:
    counts = {name: (sum(found), result["n_each"] * len(found)) for name, found in result["accused"].items()}
    total, of = (sum(column) for column in zip(*counts.values(), strict=True))
    return "\n".join(
        [
            f"Expected calibration error over {result['n_judged']} demonstrations: {result['ece']:.4f} (goal .05); "
            f"{result['n_ambiguous']} draws answered ambiguous.",
            f"The interval for the share of experts held the truth in {result['covered']:.0%} of draws (goal 90 %).",
            f"Without signal {total} of {of} were called adversaries, {total / of:.1%} (goal 5 %): "
            + ", ".join(f"{name} {some} of {n}" for name, (some, n) in counts.items())
            + ".",
        ]
    )


if __name__ == "__main__":
    raise SystemExit(main())
