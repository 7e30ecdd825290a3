"""Witnesses of unknown reliability and sign beside four answers: rows of benchmarks/answers.py.

Five flags are right of 60 to 90 % of the demonstrations. Two err together, and one is reversed. A coin is added to
them, or two coins or one flag are all there is. Operators are witnesses, too: their names are given, by chance, or not
at all. And sets of one family, or three parts of a set, are tasks, or sessions, whose answers count together or alone.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from unittest.mock import patch

import numpy as np

from answer_draws import answered, drawn, mean, rest_of
from claims import Row, auroc
from rpil.data.fit_data import Demonstrators
from rpil.inference import answered as inference
from rpil.inference.answered import Answered
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS
from rpil.results.tasks import widened
from worlds import Array

RIGHT = (0.6, 0.7, 0.75, 0.8, 0.9)
"""Shares of the demonstrations of which five witnesses are right."""
TOGETHER = 0.8
"""Share of the demonstrations in which the second witness errs where the first one does."""
N_ANSWERS = 4
FLAG = 0.8
"""How often a flag is right."""


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

    def found(audit: Row, chosen: Array, rng: np.random.Generator) -> dict[str, Answered]:
        good = audit["good"]
        truth = np.where(good >= 0, good, rng.integers(0, 2, len(good)))
        flags, coin = five(truth, rng), rng.integers(0, 2, len(good)).astype(float)
        answers, mostly = truly(good, chosen), np.where(rng.random(len(good)) < FLAG, truth, 1 - truth).astype(float)
        kinds = {
            "four answers": flags[:, :0],
            "five witnesses": flags,
            "and a coin": np.column_stack([flags, coin]),
            "two coins": np.column_stack([coin, coin[::-1]]),
            "a flag right of 80 %": mostly[:, None],
            "a flag by a coin": coin[:, None],
        }
        return {kind: answered(audit, replace(answers, outcomes=columns)) for kind, columns in kinds.items()}

    return counted(sets, draws, N_ANSWERS, found)


def by_operators(sets: list[Row], draws: int, count: int) -> list[Row]:
    """Random labels of sets whose operators are known: with their names, with names by chance, and without; and labels
    by a coin with their names."""

    def found(audit: Row, chosen: Array, rng: np.random.Generator) -> dict[str, Answered]:
        who, answers = audit["who"], truly(audit["good"], chosen)
        by_chance = Demonstrators(rng.permutation(who.index), who.names)
        coins = np.zeros(len(audit["good"]), dtype=int)
        coins[chosen] = rng.choice([1, -1], count)
        return {
            "without operators": answered(audit, answers),
            "operators named": answered(audit, answers, who=who),
            "operators by chance": answered(audit, answers, who=by_chance),
            "operators named, a coin": answered(audit, Answers.of_labels(coins), who=who),
        }

    return counted([audit for audit in sets if audit["who"].informative], draws, count, found)


FAMILIES = ("metaworld", "overcooked")
"""Sets whose names begin so are tasks of one recording."""


def by_tasks(sets: list[Row], draws: int, count: int) -> list[Row]:
    """Random labels of tasks of one family, of a set in three sessions, and of three sets that have nothing in common,
    judged together and each by itself, and together without a rule; and by a coin, together."""
    rng, rows = np.random.default_rng(0), list[Row]()
    families = [[audit for audit in sets if audit["name"].startswith(name)] for name in FAMILIES]
    parts = [[of_part(audit, k) for k in range(3)] for audit in sets]
    others = [[sets[m] for m in rng.permutation(len(sets))[:3]] for _ in sets]
    groups = dict(zip(FAMILIES, [[own] for own in families if own], strict=False))
    for name, many in (groups | {"three sessions": parts, "three unlike sets": others}).items():
        found = counted([together(each) for each in many], draws, count, in_tasks)
        rows += [row | {"what": f"{name}, {row['what']}"} for row in found]
    return rows


def of_part(audit: Row, k: int) -> Row:
    """The audit of every third demonstration."""
    own = np.arange(len(audit["good"])) % 3 == k
    return {"good": audit["good"][own], "columns": audit["columns"][own]}


def together(audits: list[Row]) -> Row:
    """One audit of tasks, as `rpil.results.tasks` joins them."""
    width = max(audit["columns"].shape[1] for audit in audits)
    columns = [widened(audit["columns"], width) for audit in audits]
    lengths = [len(own) for own in columns]
    good = np.concatenate([audit["good"] for audit in audits])
    return {"good": good, "columns": np.concatenate(columns), "task": np.repeat(np.arange(len(audits)), lengths)}


def in_tasks(audit: Row, chosen: Array, rng: np.random.Generator) -> dict[str, Answered]:
    """What answers make of the tasks."""
    task, answers, coins = audit["task"], truly(audit["good"], chosen), np.zeros(len(audit["good"]), dtype=int)
    coins[chosen] = rng.choice([1, -1], len(chosen))
    every, by_coin = (answered(audit, one, task_of=task) for one in (answers, Answers.of_labels(coins)))
    log_odds, verdicts = np.zeros(len(task)), np.zeros(len(task), dtype=int)
    for rows in (np.flatnonzero(task == k) for k in np.unique(task)):
        own = answered({"columns": audit["columns"][rows]}, answers.select(rows.tolist()))
        log_odds[rows], verdicts[rows] = own.log_odds, own.verdicts
    alone = replace(every, log_odds=log_odds, verdicts=verdicts)
    rules = {"one trust": ("trust_in_tasks", one_trust), "no weights of their own": ("with_tasks", shared_columns)}
    found = {"together": every, "each by itself": alone, "together, a coin": by_coin}
    for name, (rule, instead) in rules.items():
        with patch.object(inference, rule, instead):
            found[name] = answered(audit, answers, task_of=task)
    return found


def one_trust(trust: float, of_answer: Array, right: Array, task: Array, least: float) -> Array:
    """The trust in all answers, in tasks that have answers."""
    return np.where(np.isin(task, of_answer), trust, least)


def shared_columns(columns: Array, *_: object) -> Array:
    """The channels and the group, which all tasks share."""
    return np.column_stack([columns[:, : len(CHANNELS)], columns[:, -1]])


def truly(good: Array, chosen: Array) -> Answers:
    """True labels of the `chosen`."""
    labels = np.zeros(len(good), dtype=int)
    labels[chosen] = 2 * good[chosen] - 1
    return Answers.of_labels(labels)


def counted(
    sets: list[Row], draws: int, count: int, found: Callable[[Row, Array, np.random.Generator], dict[str, Answered]]
) -> list[Row]:
    """AUROC and verdicts of the rest by each kind of what is `found` from draws of `count` labels."""
    values, words = defaultdict[str, list[float]](list), defaultdict[str, Array](lambda: np.zeros(3, dtype=int))
    for audit in sets:
        own, good = defaultdict[str, list[float]](list), audit["good"]
        for draw in range(draws):
            rng = np.random.default_rng(draw)
            chosen = drawn(good, count, rng)
            if chosen is None:
                continue
            rest = rest_of(audit, chosen)
            for kind, one in found(audit, chosen, rng).items():
                said = one.verdicts[rest]
                own[kind].append(auroc(good[rest], one.log_odds[rest]))
                words[kind] += [(said != 0).sum(), (said * (2 * good[rest] - 1) < 0).sum(), len(rest)]
        for kind, of_draws in own.items():
            values[kind].append(float(np.mean(of_draws)))
    rows = []
    for kind, (given, wrong, total) in words.items():
        rows.append({"what": f"{count} random labels, {kind}: AUROC of the rest", "figure": mean(values[kind])})
        figure = f"{given / max(total, 1):.0%} have a verdict, {wrong} of {given} wrong ({wrong / max(given, 1):.1%})"
        rows.append({"what": f"{count} random labels, {kind}: verdicts", "figure": figure})
    return rows
