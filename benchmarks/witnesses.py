"""Witnesses of unknown reliability and sign beside four answers: rows of benchmarks/answers.py.

Five flags are right of 60 to 90 % of the demonstrations. Two err together, and one is reversed. A coin is added to
them, or two coins are all there is. Operators are witnesses, too: their names are given, by chance, or not at all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from answer_draws import answered, drawn, mean, rest_of
from claims import Row, auroc
from rpil.data.fit_data import Demonstrators
from rpil.inference.answers import Answers
from worlds import Array

RIGHT = (0.6, 0.7, 0.75, 0.8, 0.9)
"""Shares of the demonstrations of which five witnesses are right."""
TOGETHER = 0.8
"""Share of the demonstrations in which the second witness errs where the first one does."""
N_ANSWERS = 4


def five(good: Array, rng: np.random.Generator) -> Array:
    """Flags (M, 5) of witnesses."""
    wrong = rng.random((len(good), len(RIGHT))) > rng.permutation(RIGHT)
    wrong[:, 1] = np.where(rng.random(len(good)) < TOGETHER, wrong[:, 0], wrong[:, 1])
    flags = np.where(wrong, 1 - good[:, None], good[:, None])
    reversed_one = rng.integers(len(RIGHT))
    flags[:, reversed_one] = 1 - flags[:, reversed_one]
    return np.asarray(flags, dtype=float)


def by_witnesses(sets: list[Row], draws: int) -> list[Row]:
    """Five witnesses and four answers, the same and a coin, a coin and four answers, and answers alone."""
    kinds = {
        "four answers": lambda flags, coin: flags[:, :0],
        "five witnesses": lambda flags, coin: flags,
        "and a coin": lambda flags, coin: np.column_stack([flags, coin]),
        "two coins": lambda flags, coin: np.column_stack([coin, coin[::-1]]),
    }
    values, words = {kind: [] for kind in kinds}, {kind: np.zeros(3, dtype=int) for kind in kinds}
    for audit in sets:
        own = {kind: [] for kind in kinds}
        for draw in range(draws):
            rng, good = np.random.default_rng(draw), audit["good"]
            chosen = drawn(good, N_ANSWERS, rng)
            if chosen is None:
                continue
            truth, rest = np.where(good >= 0, good, rng.integers(0, 2, len(good))), rest_of(audit, chosen)
            flags, coin = five(truth, rng), rng.integers(0, 2, len(good)).astype(float)
            labels = np.zeros(len(good), dtype=int)
            labels[chosen] = 2 * good[chosen] - 1
            for kind, columns in kinds.items():
                found = answered(audit, replace(Answers.of_labels(labels), outcomes=columns(flags, coin)))
                own[kind].append(auroc(good[rest], found.log_odds[rest]))
                said = found.verdicts[rest]
                words[kind] += [(said != 0).sum(), (said * (2 * good[rest] - 1) < 0).sum(), len(rest)]
        for kind, found in own.items():
            values[kind] += [np.mean(found)] if found else []
    rows = []
    for kind, (given, wrong, total) in words.items():
        rows.append({"what": f"{N_ANSWERS} random labels, {kind}: AUROC of the rest", "figure": mean(values[kind])})
        figure = f"{given / max(total, 1):.0%} have a verdict, {wrong} of {given} wrong ({wrong / max(given, 1):.1%})"
        rows.append({"what": f"{N_ANSWERS} random labels, {kind}: verdicts", "figure": figure})
    return rows


def by_operators(sets: list[Row], draws: int, count: int) -> list[Row]:
    """Random labels of sets whose operators are known: with their names, with names by chance, and without; and labels
    by a coin with their names."""
    kinds = ("without operators", "operators named", "operators by chance", "operators named, a coin")
    values, words = {kind: [] for kind in kinds}, {kind: np.zeros(3, dtype=int) for kind in kinds}
    for audit in sets:
        own = {kind: [] for kind in kinds}
        for draw in range(draws if audit["who"].informative else 0):
            rng, good = np.random.default_rng(draw), audit["good"]
            chosen = drawn(good, count, rng)
            if chosen is None:
                continue
            who, rest = audit["who"], rest_of(audit, chosen)
            by_chance = Demonstrators(rng.permutation(who.index), who.names)
            for kind, named in zip(kinds, (Demonstrators(), who, by_chance, who), strict=True):
                labels = np.zeros(len(good), dtype=int)
                labels[chosen] = rng.choice([1, -1], count) if "coin" in kind else 2 * good[chosen] - 1
                found = answered(audit, Answers.of_labels(labels), who=named)
                own[kind].append(auroc(good[rest], found.log_odds[rest]))
                said = found.verdicts[rest]
                words[kind] += [(said != 0).sum(), (said * (2 * good[rest] - 1) < 0).sum(), len(rest)]
        for kind, found in own.items():
            values[kind] += [np.mean(found)] if found else []
    rows = []
    for kind, (given, wrong, total) in words.items():
        rows.append({"what": f"{count} random labels, {kind}: AUROC of the rest", "figure": mean(values[kind])})
        figure = f"{given / max(total, 1):.0%} have a verdict, {wrong} of {given} wrong ({wrong / max(given, 1):.1%})"
        rows.append({"what": f"{count} random labels, {kind}: verdicts", "figure": figure})
    return rows
