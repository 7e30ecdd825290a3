"""What answers teach: labels, one pair, outcomes and wrong answers, on recorded sets with a known truth.

    python benchmarks/answers.py --data ../shared/data --json answers.json
    python benchmarks/answers.py --quick

Every set is audited once, without answers. Then draws of labels (at most half of a set, and at least 3 of each sort
left to score) are answered, and the rest is scored. AUROC is that of the rest. Means have standard errors over sets.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from functools import partial
from itertools import product
from multiprocessing import Pool
from operator import call
from pathlib import Path

import numpy as np
from scipy.special import logit
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import cross_val_predict

from answer_draws import (
    N_LEFT,
    SETTINGS,
    answered,
    audited,
    compared,
    drawn,
    labelled,
    mean,
    recorded_jobs,
    rest_of,
    simulated_jobs,
    suggested,
    table_jobs,
)
from answer_goals import by_both_good, by_coin, by_one_side, by_questions, by_success
from claims import Job, Row, auroc
from options import asked
from provenance import line, provenance
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS
from witnesses import by_operators, by_tasks, by_witnesses
from worlds.simulated import of_paper

LOW = 0.4
"""AUROC without answers below which a set is reversed."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of NPZ files")
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="OUT", help="also write every figure")
    parser.add_argument("--quick", action="store_true", help="two small worlds: checks the script")
    options = parser.parse_args(arguments)
    if not (options.data or options.quick):
        parser.error("say where the NPZ files are: --data DIR.")
    draws = 1 if options.quick else options.draws
    jobs = [Job("quick", "", partial(of_paper, "MountainCar-v0", "random", seed)) for seed in range(2)]
    if not options.quick:
        jobs = [*recorded_jobs(options.data), *simulated_jobs(), *table_jobs(options.data)]
    with Pool(options.processes, maxtasksperchild=20) as pool:
        audits = pool.map(audited, jobs)
        sets = [audit for audit in audits if audit["kind"] in ("recorded", "quick")]
        parts = [partial(by_labels, sets, draws, count) for count in (2, 4, 8, 16)]
        new_kinds = [audit for audit in audits if audit["kind"] == "new kinds"]
        parts += [partial(by_labels_of_new_kinds, [audit], draws) for audit in new_kinds]
        parts += [partial(never_lower, sets, draws), partial(by_pair, audits), partial(by_one_wrong, sets, draws)]
        parts += [partial(by_ties, sets, draws)]
        parts += [partial(by_coin, audits, draws, *way) for way in ((8,), (16,), (8, True))]
        parts += [partial(by_suggestion, sets, draws, count) for count in (4, 8)]
        parts += [partial(by_one_side, sets, 2 * draws, k, side) for side in (1, -1) for k in (1, 2, 3)]
        parts += [partial(by_questions, [audit], draws) for audit in sets]
        parts += [partial(by_both_good, sets)]
        parts += [partial(by_success, options.quick), partial(by_witnesses, sets, draws)]
        parts += [partial(by_operators, sets, draws, count) for count in (8, 16)]
        parts += [partial(by_tasks, sets, draws, count) for count in (8, 16)]
        parts += [partial(by_outcome, sets, draws), partial(by_nonsense, audits, draws)]
        rows = [row for found in pool.imap(call, parts) for row in found]
    print(table(rows))
    origin = provenance(draws, asked(parser, options))
    print(f"\n{line(origin)}")
    if options.json:
        options.json.write_text(json.dumps({"provenance": origin, "rows": rows}))
    return 0


def markdown(result: Row) -> str:
    """The section of docs/results.md."""
    text = "The table shows the effect of labels, a pair, outcomes and wrong answers (`benchmarks/answers.py`)."
    return f"## Answers\n\n{text}\n\n{table(result['rows'])}"


def table(rows: list[Row]) -> str:
    return "\n".join(["| what | figure |", "|---|---|", *(f"| {row['what']} | {row['figure']} |" for row in rows)])


# ---- answers ---------------------------------------------------------------------------------------------------------


def is_low(audit: Row) -> bool:
    return auroc(audit["good"], audit["log_odds"]) < LOW


def by_labels(sets: list[Row], draws: int, count: int) -> list[Row]:
    """Random labels."""
    values, low, wrong, given, total = [], [], 0, 0, 0
    for audit in sets:
        own = []
        for draw in range(draws):
            chosen = drawn(audit["good"], count, np.random.default_rng(draw))
            if chosen is None:
                continue
            found, rest = labelled(audit, chosen), rest_of(audit, chosen)
            good, verdicts = audit["good"][rest], found.verdicts[rest]
            own.append(auroc(good, found.log_odds[rest]))
            wrong += int(((verdicts > 0) & (good == 0)).sum() + ((verdicts < 0) & (good == 1)).sum())
            given, total = given + int((verdicts != 0).sum()), total + len(rest)
        if own:
            values.append(np.mean(own))
            low += [np.mean(own)] if is_low(audit) else []
    verdicts = f"{wrong} of {given} wrong ({wrong / max(given, 1):.1%}), {given / max(total, 1):.0%} have one"
    return [
        {"what": f"{count} random labels: AUROC of the rest", "figure": mean(values)},
        {"what": f"{count} random labels: sets below {LOW} without", "figure": mean(low)},
        {"what": f"{count} random labels: verdicts", "figure": verdicts},
    ]


def by_labels_of_new_kinds(sets: list[Row], draws: int, count: int = 8) -> list[Row]:
    """Random labels, and a logistic regression on the components alone."""
    rows = by_labels(sets, draws, count)
    for row in rows:
        row["what"] = f"{sets[0]['name']}: {row['what']}"
    values = []
    for audit, draw in product(sets, range(draws)):
        chosen = drawn(audit["good"], count, np.random.default_rng(draw))
        if chosen is not None:
            seen, rest = audit["columns"][:, len(CHANNELS) : -1], rest_of(audit, chosen)
            model = LogisticRegression().fit(seen[chosen], audit["good"][chosen])
            values.append(auroc(audit["good"][rest], model.decision_function(seen[rest])))
    what = f"{sets[0]['name']}: regression on the components, {count} random labels: AUROC of the rest"
    return [rows[0], rows[2], {"what": what, "figure": f"{np.mean(values):.3f}"}]


def never_lower(sets: list[Row], draws: int) -> list[Row]:
    """Sets that eight labels make worse than none."""
    lower = []
    for audit in sets:
        lost = []
        for draw in range(draws):
            chosen = drawn(audit["good"], 8, np.random.default_rng(draw))
            if chosen is not None:
                rest = rest_of(audit, chosen)
                before, after = audit["log_odds"][rest], labelled(audit, chosen).log_odds[rest]
                lost.append(auroc(audit["good"][rest], before) - auroc(audit["good"][rest], after))
        if len(lost) > 1 and np.mean(lost) > 0.02 + 2 * np.std(lost, ddof=1) / np.sqrt(len(lost)):
            lower.append(f"{audit['name']} by {np.mean(lost):.2f}")
    what = "8 labels: sets lower by more than .02 and two standard errors"
    return [{"what": what, "figure": f"{len(lower)} of {len(sets)}" + (f": {', '.join(lower)}" if lower else "")}]


def by_pair(audits: list[Row]) -> list[Row]:
    """The pair that is asked, answered by the truth."""
    rows = []
    for kind in dict.fromkeys(audit["kind"] for audit in audits):
        own = [audit for audit in audits if audit["kind"] == kind]
        answered = [(audit, compared(audit)) for audit in own]
        if kind == "half":
            bad = sum(int((found.verdicts < 0).sum()) for _, found in answered if found)
            rows.append({"what": "good halves, the pair answered by quality: verdicts", "figure": f"{bad} bad"})
            continue
        one_each = sum({0, 1} == set(audit["good"][audit["pair"]].tolist()) for audit in own if audit["pair"])
        values = [auroc(audit["good"], found.log_odds) for audit, found in answered if found]
        high, low = sum(value >= 0.99 for value in values), sum(value < 0.5 for value in values)
        text = f"{mean(values)}; {high} at .99 or more, {low} below .5"
        rows.append({"what": f"{kind}: the pair holds one good and one bad", "figure": f"{one_each} of {len(own)}"})
        rows.append({"what": f"{kind}: AUROC with the pair answered", "figure": text})
        verdicts = sum(int((found.verdicts != 0).sum()) for _, found in answered if found)
        rows.append({"what": f"{kind}: verdicts after this one answer", "figure": f"{verdicts}"})
    return rows


def by_ties(sets: list[Row], draws: int, count: int = 8) -> list[Row]:
    """True answers about random pairs, of which two of the same kind are the same: this is said, or left out."""
    means = []
    for audit in sets:
        good, known = audit["good"], np.flatnonzero(audit["good"] >= 0)
        own = []
        for draw in range(draws):
            rng = np.random.default_rng(draw)
            pairs = np.array([rng.choice(known, 2, replace=False) for _ in range(count)])
            pairs = np.take_along_axis(pairs, np.argsort(-good[pairs], axis=1, kind="stable"), axis=1)  # the good first
            same, rest = good[pairs[:, 0]] == good[pairs[:, 1]], rest_of(audit, pairs)
            if min((good[rest] == 1).sum(), (good[rest] == 0).sum()) >= N_LEFT:
                left_out = replace(Answers.of_labels(np.zeros(len(good), dtype=int)), pairs=pairs[~same])
                ways = replace(left_out, tied=pairs[same]), left_out
                own.append([auroc(good[rest], answered(audit, way).log_odds[rest]) for way in ways])
        means += [np.mean(own, axis=0)] if own else []
    said, left = np.reshape(means, (-1, 2)).T
    return [
        {"what": f"{count} random pairs, those of one kind the same: AUROC of the rest", "figure": mean(said)},
        {"what": f"{count} random pairs, those of one kind left out: AUROC of the rest", "figure": mean(left)},
        {
            "what": "the first over the second",
            "figure": f"{mean(said - left)}; lowest {min(said - left, default=0):+.3f}",
        },
    ]


def by_one_wrong(sets: list[Row], draws: int) -> list[Row]:
    """One wrong label of five."""
    lost, named, right, n_right, n = [], 0, 0, 0, 0
    for audit, draw in product(sets, range(draws)):
        rng = np.random.default_rng(100 + draw)
        chosen = drawn(audit["good"], 5, rng)
        if chosen is None:
            continue
        signs, rest = 2 * audit["good"][chosen] - 1, rest_of(audit, chosen)
        true = labelled(audit, chosen, signs).log_odds[rest]
        wrong = int(rng.integers(5))
        signs[wrong] *= -1
        found = labelled(audit, chosen, signs, SETTINGS)
        lost.append(auroc(audit["good"][rest], true) - auroc(audit["good"][rest], found.log_odds[rest]))
        others = set(found.contradicting.tolist()) - {int(chosen[wrong])}
        named, n = named + (int(chosen[wrong]) in found.contradicting), n + 1
        right, n_right = right + len(others), n_right + 4
    return [
        {"what": "one wrong label of five: AUROC lost", "figure": mean(lost)},
        {"what": "one wrong label of five: it is named", "figure": f"{named} of {n} draws"},
        {"what": "one wrong label of five: right ones that are named", "figure": f"{right} of {n_right}"},
    ]


def by_suggestion(sets: list[Row], draws: int, count: int) -> list[Row]:
    """Suggested labels against random ones: AUROC, words, and the bad ones that are called bad."""
    gains, words, named = [], [], []
    for audit in sets:
        random = []
        for draw in range(draws):
            chosen = drawn(audit["good"], count, np.random.default_rng(draw))
            if chosen is not None:
                rest = rest_of(audit, chosen)
                random.append(auroc(audit["good"][rest], labelled(audit, chosen).log_odds[rest]))
        chosen = suggested(audit, count)
        rest = rest_of(audit, chosen)
        good, found = audit["good"][rest], labelled(audit, chosen)
        if random and min((good == 1).sum(), (good == 0).sum()) >= N_LEFT:
            gains.append(auroc(good, found.log_odds[rest]) - np.mean(random))
            said = found.verdicts[rest]
            words.append([(said != 0).sum(), (said * (2 * good - 1) < 0).sum(), len(rest)])
            named.append([((said < 0) & (good == 0)).sum(), (good == 0).sum()])
    if not gains:
        return []
    (given, wrong, total), (bad, of_bad) = np.sum(words, axis=0), np.sum(named, axis=0)
    figure = (
        f"{wrong} of {given} wrong ({wrong / max(given, 1):.1%}), {given / total:.0%} have one, {bad} of {of_bad} bad"
    )
    return [
        {"what": f"{count} suggested labels over random ones: AUROC", "figure": mean(gains)},
        {"what": f"{count} suggested labels: verdicts", "figure": figure},
    ]


def by_outcome(sets: list[Row], draws: int) -> list[Row]:
    """The quality of a random half as outcome, against a logistic regression on all labels in five folds."""
    values, regression = [], []
    for audit in sets:
        good, known = audit["good"], np.flatnonzero(audit["good"] >= 0)
        if min((good == 1).sum(), (good == 0).sum()) < 5:
            continue
        own = []
        for draw in range(draws):
            shown = np.random.default_rng(draw).random(len(good)) < 0.5
            none = np.zeros(len(good), dtype=int)
            quality = np.where(shown, audit["quality"], np.nan)
            answers = replace(Answers.of_labels(none), outcomes=quality[:, None], names=("quality",))
            rest = known[~shown[known]]
            own.append(auroc(good[rest], answered(audit, answers).log_odds[rest]))
        values.append(np.nanmean(own))
        model = LogisticRegression(C=1.0, max_iter=1000)
        proba = cross_val_predict(model, audit["columns"][known], good[known], cv=5, method="predict_proba")[:, 1]
        regression.append(auroc(good[known], logit(np.clip(proba, 1e-9, 1 - 1e-9))))
    return [
        {"what": "quality of a half as outcome: AUROC of the other half", "figure": mean(values)},
        {"what": "logistic regression on all labels, five folds", "figure": mean(regression)},
    ]


def by_nonsense(audits: list[Row], draws: int) -> list[Row]:
    """Random answers about good demonstrations: one wrong answer alone, and eight labels that mean nothing."""
    alone, bad, n = 0, 0, 0
    for audit in audits:
        m = int(np.argmin(audit["log_odds"]))
        verdicts = labelled(audit, np.array([m]), np.array([1 - 2 * audit["good"][m]])).verdicts
        alone += int((np.delete(verdicts, m) != 0).sum())
        if audit["kind"] != "half" or len(audit["good"]) < 16:
            continue
        for draw in range(draws):
            rng = np.random.default_rng(draw)
            chosen = rng.choice(len(audit["good"]), 8, replace=False)
            rest = np.setdiff1d(np.arange(len(audit["good"])), chosen)
            verdicts = labelled(audit, chosen, rng.permutation([1, -1] * 4)).verdicts[rest]
            bad, n = bad + int((verdicts < 0).sum()), n + len(rest)
    return [
        {"what": "one wrong answer alone: verdicts of the others", "figure": f"{alone}"},
        {"what": "good halves, eight labels drawn at random: called bad", "figure": f"{bad} of {n}"},
    ]


if __name__ == "__main__":
    sys.exit(main())
