"""What answers must not do, and what they must: rows of benchmarks/answers.py.

Answers of one side, questions that are asked one after the other, both good, an outcome known for all.
"""

from __future__ import annotations

import warnings
from functools import partial
from importlib.util import find_spec
from itertools import product

import numpy as np

import rpil
from answer_draws import N_LEFT, SETTINGS, answered, labelled, mean, next_asked, rest_of
from claims import Row, auroc
from rpil.inference.answers import Answers
from value import worlds
from worlds import Array

HIGH = 0.8
"""AUROC without answers from which one side must not turn a set."""
N_QUESTIONS = 32
LONG = 200
"""Demonstrations of a set that is asked so many questions."""
OF_EACH = "good", "columns", "log_odds"
"""Arrays of an audit with a row for each demonstration."""
ARM_SIZE, ARM_BAD, ARM_SEED, ARM_SEEDS = 49, 0.45, 900, 3
"""Demonstrations of an arm's set, the share of bad ones, the first seed, and how many."""


def before(audit: Row) -> float:
    return auroc(audit["good"], audit["log_odds"])


def by_one_side(sets: list[Row], draws: int, k: int, side: int) -> list[Row]:
    """`k` labels that are all good, or all bad."""
    changes, n_bad = {}, 0
    for audit in sets:
        pool = np.flatnonzero(audit["good"] == (side > 0))
        if before(audit) < HIGH or len(pool) < k + N_LEFT:
            continue
        own = []
        for draw in range(draws):
            chosen = np.random.default_rng(draw).choice(pool, k, replace=False)
            rest, found = rest_of(audit, chosen), labelled(audit, chosen)
            good = audit["good"][rest]
            own.append(auroc(good, found.log_odds[rest]) - auroc(good, audit["log_odds"][rest]))
            n_bad += int((found.verdicts[rest] < 0).sum()) if side > 0 else 0
        changes[audit["name"]] = own
    if not changes:
        return []
    worst = min(changes, key=lambda name: np.mean(changes[name]))
    lowest = np.quantile(np.concatenate(list(changes.values())), 0.05)
    figure = f"{np.mean(changes[worst]):+.3f} ({worst}); 5 % quantile of draws {lowest:+.3f}; {len(changes)} sets"
    what = f"{k} {'good' if side > 0 else 'bad'} alone, sets of AUROC {HIGH} or more: worst mean change of a set"
    rows = [{"what": what, "figure": figure}]
    return [*rows, {"what": f"{k} good alone: called bad", "figure": f"{n_bad}"}] if side > 0 else rows


def by_coin(audits: list[Row], draws: int, count: int, as_asked: bool = False) -> list[Row]:
    """Labels by a coin, of random demonstrations or of those that are asked for: verdicts on the others, in sets with
    bad ones and where nobody is bad."""
    rows, way = [], " as asked" if as_asked else ""
    for kind in dict.fromkeys(audit["kind"] for audit in audits):
        shares = []
        for k, audit in enumerate(audits):
            n = len(audit["good"])
            for draw in range(draws if audit["kind"] == kind and count <= n / 2 else 0):
                rng, labels = np.random.default_rng([draw, k]), np.zeros(n, dtype=int)
                if as_asked:
                    for coin in rng.choice([1, -1], count):
                        labels[next_asked(audit, labels, [])] = coin
                else:
                    chosen = rng.choice(n, count, replace=False)
                    labels[chosen] = rng.choice([1, -1], count)
                verdicts = answered(audit, Answers.of_labels(labels)).verdicts
                shares.append((verdicts[labels == 0] != 0).mean())
        if shares:
            figure = f"{np.mean(shares):.1%} of the others have one; at most {max(shares):.0%} of a draw"
            rows.append({"what": f"{kind}: {count} labels{way} by a coin: verdicts", "figure": figure})
    return rows


def by_questions(sets: list[Row], draws: int) -> list[Row]:
    """True answers to the questions that are asked, one at a time, of demonstrations in another order each time."""
    rows = []
    for audit in (audit for audit in sets if len(audit["good"]) >= LONG):
        most, disobeyed = [], 0
        for draw in range(draws):
            order = np.random.default_rng(draw).permutation(len(audit["good"]))
            shuffled = audit | {name: audit[name][order] for name in OF_EACH}
            called, missed = asked(shuffled)
            most, disobeyed = [*most, called], disobeyed + missed
        what = f"{audit['name']}, {N_QUESTIONS} true answers as asked: good ones called bad at any time"
        figure = f"at most {max(most)}, mean {np.mean(most):.1f}; labels not obeyed {disobeyed}"
        rows.append({"what": what, "figure": figure})
    return rows


def asked(audit: Row) -> tuple[int, int]:
    """The most good ones that are called bad at any time, and the labels that are not obeyed."""
    good, labels = audit["good"], np.zeros(len(audit["good"]), dtype=int)
    unknown, most, disobeyed = np.flatnonzero(good < 0).tolist(), 0, 0
    for _ in range(N_QUESTIONS):
        m = next_asked(audit, labels, unknown)
        labels[m] = 2 * good[m] - 1
        verdicts = answered(audit, Answers.of_labels(labels), SETTINGS).verdicts
        most = max(most, int(((verdicts < 0) & (good == 1)).sum()))
        disobeyed += int((verdicts != labels)[labels != 0].sum())
    return most, disobeyed


def by_both_good(sets: list[Row]) -> list[Row]:
    """Sets of two groups, each with a good one in the middle: both are good."""
    rows = []
    for audit in sets:
        if audit["finding"] == "two groups" and (audit["good"][audit["pair"]] == 1).all():
            value = auroc(audit["good"], labelled(audit, np.array(audit["pair"])).log_odds)
            figure = f"{value:.3f} (before {before(audit):.3f})"
            rows.append({"what": f"{audit['name']}: AUROC after both good", "figure": figure})
    return rows


def by_success(quick: bool) -> list[Row]:
    """Success known for all, on sets of Meta-World's arm; nothing where it is not installed."""
    if quick or find_spec("metaworld") is None:
        return []
    found = [of_success(task, ARM_SEED + n) for n, task in product(range(ARM_SEEDS), worlds.ARM_TASKS)]
    rows = []
    for k, what in enumerate(("P(good)", "success alone", "log-odds without answers", "success, then log-odds")):
        rows.append({"what": f"success of all, arm, AUROC: {what}", "figure": mean(values[k] for values, _ in found)})
    wrong, given = np.sum([verdicts for _, verdicts in found], axis=0)
    return [*rows, {"what": "success of all, arm: verdicts", "figure": f"{wrong} of {given} wrong"}]


def of_success(task: str, seed: int) -> tuple[list[float], Array]:
    """AUROC by the four scores, and the verdicts: those that are wrong, and all."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        world = worlds.make_world(task, ARM_SIZE, ARM_BAD, seed)
        audit = rpil.audit(world.demonstrations)
    good, success = world.is_good.astype(int), world.success.astype(float)
    row = {"good": good, "columns": audit.columns}
    known = Answers(np.zeros(len(good), dtype=int), np.empty((0, 2), dtype=int), success[:, None], names=("success",))
    found = answered(row, known, SETTINGS)
    both = 1e6 * success + audit.log_odds
    score = partial(auroc, good)
    wrong = (found.verdicts > 0) & (good == 0) | (found.verdicts < 0) & (good == 1)
    verdicts = np.array([wrong.sum(), (found.verdicts != 0).sum()])
    return [score(found.log_odds), score(success), score(audit.log_odds), score(both)], verdicts
