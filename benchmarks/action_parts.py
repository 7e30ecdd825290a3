"""How well does the audit rank demonstrations whose actions have several parts, or are texts of many kinds?

    python benchmarks/action_parts.py
    python benchmarks/action_parts.py --quick

The worlds are those of `worlds/parts.py`; 12 of 48 demonstrations are bad. AUROC of good against bad by the audit; by
an audit of the same actions where their kind is known: states within each skill, combinations of keys, the true classes
of texts; by the law of the experts; by the audit of the best part alone; and of codes that are taken for numbers. In
clean worlds nobody is bad: outliers are wrong, and so are verdicts by labels that a coin has drawn. Means over seeds.

The second table is of policies: the mean log-likelihood of a step of other good demonstrations, means over half as many
seeds. They are fitted with the weights of the audit after 12 answers, with those without answers, to all alike, and to
the good ones alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np
from sklearn.metrics import roc_auc_score

import rpil
from rpil import RPIL, BehavioralCloning
from rpil.results.result import AuditResult
from tables import table
from worlds.parts import WORLDS, Array, PartsWorld

N_SEEDS, N_QUICK = 10, 2
N_LABELS = 8
N_ANSWERS = 12


def audited(world: PartsWorld, kind: str = "auto", **other: Array | dict[str, Array]) -> AuditResult:
    """The audit of a world, with `other` states or parts of the action."""
    return rpil.audit(world.table(**other), action_kind=kind)


def auroc(world: PartsWorld, score: Sequence[float]) -> float:
    """Of good against bad."""
    return float(roc_auc_score(world.is_good, score))


def ranked(world: PartsWorld) -> list[float]:
    """AUROC by the audit, by the known kind, by the law, by the best part alone, and by codes as numbers."""
    alone = [auroc(world, audited(world, parts={"action": part}).log_odds) for part in world.actions.values()]
    states, parts = world.known
    known = audited(world, "continuous" if len(parts) > 1 else "discrete", states=states, parts=parts)
    codes = {name: np.unique(part, return_inverse=True)[1] for name, part in world.actions.items()}
    numbers = {n: (codes[n] if p.dtype.kind != "f" else p).astype(float) for n, p in world.actions.items()}
    as_numbers = audited(world, "continuous", parts=numbers)
    scores = audited(world).log_odds, known.log_odds, world.by_law
    return [*(auroc(world, score) for score in scores), max(alone), auroc(world, as_numbers.log_odds)]


def said_wrongly(world: PartsWorld, seed: int) -> list[float]:
    """Shares of a clean world that are outliers, and that have a verdict by labels of a coin."""
    audit, rng = audited(world), np.random.default_rng(seed)
    asked = rng.choice(len(world.is_good), N_LABELS, replace=False)
    labels = {audit.ids[m]: str(rng.choice(["good", "bad"])) for m in asked}
    told = np.array(audit.answered(labels).verdicts)
    others = ~np.isin(np.arange(len(told)), asked)
    return [np.mean(np.array(audit.verdicts) == "outlier"), np.mean(told[others] != "open")]


def learned(world: PartsWorld, seed: int) -> list[float]:
    """Log-likelihood a step of the good ones in the second half, by policies that are fitted to the first half."""
    every, is_good = rpil.read(world.table()), world.is_good == 1
    known, others = np.split(np.arange(len(is_good)), 2)
    train, test = every.select(known), every.select(others[is_good[others]])
    asked = np.random.default_rng(seed).choice(known, N_ANSWERS, replace=False)
    answers = {every.ids[m]: "good" if is_good[m] else "bad" for m in asked}
    models = [RPIL(labels=answers).fit(train), RPIL().fit(train), BehavioralCloning().fit(train)]
    models.append(BehavioralCloning().fit(train.select(np.flatnonzero(is_good[known]))))
    return [float(model.log_prob(test.observations, test.actions).mean()) for model in models]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two seeds")
    seeds = range(N_QUICK if parser.parse_args().quick else N_SEEDS)
    rows, policies = [], []
    for name, make in WORLDS.items():
        ranks = np.mean([ranked(make(seed)) for seed in seeds], axis=0)
        wrong = np.mean([said_wrongly(make(seed, n_bad=0), seed) for seed in seeds], axis=0)
        policy = np.mean([learned(make(s, n_bad=24, n=96), s) for s in range((len(seeds) + 1) // 2)], axis=0)
        policies.append([name, *(f"{value:.3f}" for value in policy)])
        rows.append([name, *(f"{value:.3f}" for value in ranks), *(f"{value:.1%}" for value in wrong)])
    print(table(["actions", "audit", "known kind", "law", "best part", "as numbers", "outliers, clean", "coin"], rows))
    print(table(["policy", f"{N_ANSWERS} answers", "no answers", "all alike", "good ones alone"], policies))


if __name__ == "__main__":
    main()
