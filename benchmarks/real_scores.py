"""How the replies of methods on recorded demonstrations agree with the truth: ranking, and held-out prediction."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata, spearmanr

from npz_sets import Truth
from real_report import OURS
from rpil.data.demonstrations import Demonstrations
from scoring import N_RESAMPLES, VERDICTS, interval, pair_wins, resampled_auroc, stream

ORACLE = "oracle"
TRAINED_ON = {"all": "trust all", "kept": OURS, "good": ORACLE}
Array = NDArray[Any]
Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Job:
    """One method on one data set: to rank all of it, or to predict the actions of those `held_out`."""

    path: Path
    method: str
    task: Any
    held_out: Array | None = None


@dataclass(frozen=True, eq=False)
class Reply:
    """The answer of a method: scores (M,), verdicts (M,) or actions (n,), or in `said` the message of its error."""

    seconds: float
    scores: Array | None = None
    verdicts: Array | None = None
    predicted: Array | None = None
    said: str | None = None


def described(demonstrations: Demonstrations, known: Truth) -> Row:
    discrete = demonstrations.is_discrete
    return {
        "demonstrations": len(demonstrations),
        "steps": demonstrations.n_steps,
        "observations": demonstrations.n_observations,
        "actions": len(np.unique(demonstrations.actions)) if discrete else demonstrations.actions.shape[1],
        "discrete": discrete,
        "good": int(known.good.sum()),
        "bad": int(known.bad.sum()),
    }


def ranking(reply: Reply, known: Truth, rng: np.random.Generator) -> tuple[Row, Array | None]:
    """How scores agree with truth, and the bootstrap draws of the AUROC."""
    row: Row = {"seconds": reply.seconds, "said": reply.said}
    row |= dict.fromkeys(("auroc", "auroc_ci95", "auroc_se", "spearman", "verdicts", "scores"))
    if reply.scores is None:
        return row, None
    scores = np.asarray(reply.scores, dtype=float)
    if scores.shape != known.good.shape or np.isnan(scores).any():
        return row | {"said": "a score is missing"}, None
    row["scores"] = [float(score) for score in np.nan_to_num(scores)]  # JSON knows no infinity
    if len(set(known.quality)) > 1 and len(set(scores)) > 1:
        ranks = rankdata(scores)  # because SciPy before 1.15 takes infinite scores for missing ones
        row["spearman"] = float(spearmanr(ranks, known.quality).statistic)
    if reply.verdicts is not None:
        row["verdicts"] = {
            name: {verdict: int((reply.verdicts[mask] == verdict).sum()) for verdict in VERDICTS}
            for name, mask in (("good", known.good), ("bad", known.bad))
        }
    if not (known.good.any() and known.bad.any()):
        return row, None
    wins = pair_wins(scores[known.good], scores[known.bad])
    draws = resampled_auroc(wins, rng)
    row |= {"auroc": float(wins.mean()), "auroc_ci95": interval(draws), "auroc_se": float(draws.std())}
    return row, draws


def held_out_rows(
    name: str, replies: list[tuple[Job, Reply]], demonstrations: Demonstrations, known: Truth, seed: int
) -> list[Row]:
    """How well the held-out good demonstrations are predicted: accuracy, or R^2 where actions are continuous."""
    rows, draws = [], {}
    for trained_on, method in TRAINED_ON.items():
        folds = [(job.held_out, reply) for job, reply in replies if job.method == method and job.held_out is not None]
        if not folds:
            continue
        row: Row = {
            "set": name,
            "trained_on": trained_on,
            "measure": "accuracy" if demonstrations.is_discrete else "R²",
        }
        said = next((reply.said for _, reply in folds if reply.said), None)
        row |= {"said": said, "mean": None, "ci95": None, "gain": None, "gain_ci95": None}
        if said is None:
            loss, scale = losses(folds, demonstrations, known.good)
            counts = stream(seed, name).multinomial(len(loss), np.full(len(loss), 1 / len(loss)), N_RESAMPLES)
            draws[trained_on] = 1 - (counts @ loss) / (counts @ scale)
            row |= {"mean": float(1 - loss.sum() / scale.sum()), "ci95": interval(draws[trained_on])}
            if trained_on != "all" and "all" in draws:  # the same resamples, so the difference is of pairs
                row["gain"] = row["mean"] - rows[0]["mean"]
                row["gain_ci95"] = interval(draws[trained_on] - draws["all"])
        rows.append(row)
    return rows


def losses(folds: list[tuple[Array, Reply]], demonstrations: Demonstrations, good: Array) -> tuple[Array, Array]:
    """What predictions miss of each good demonstration, (G,), and what there is to miss, (G,): steps, or squares about
    the mean action."""
    loss, scale = np.zeros((2, len(demonstrations)))
    center = None if demonstrations.is_discrete else demonstrations.select(good).actions.mean(axis=0)
    for held_out, reply in folds:
        taken = demonstrations.select(held_out)
        for m, steps in zip(held_out, np.split(np.arange(taken.n_steps), taken.offsets[1:-1]), strict=True):
            actions, predicted = taken.actions[steps], reply.predicted[steps]
            if center is None:
                loss[m], scale[m] = (actions != predicted).sum(), len(actions)
            else:
                loss[m], scale[m] = ((actions - predicted) ** 2).sum(), ((actions - center) ** 2).sum()
    return loss[good], scale[good]


def counted(sets: Row) -> list[str]:
    """The data sets that the mean AUROC is over: discrete, with bad ones."""
    return [name for name, of in sets.items() if of["discrete"] and of["good"] and of["bad"]]


def mean_aurocs(ranked: list[Row], draws: dict[tuple[str, str], Array | None], sets: Row) -> Row:
    """For each method its mean AUROC over data sets, None where one is missing, and how far ours is ahead."""
    names = counted(sets)
    means: Row = {}
    resampled = {}
    for method in dict.fromkeys(row["method"] for row in ranked):
        found = [row["auroc"] for row in ranked if row["method"] == method and row["set"] in names]
        means[method] = {"mean": None, "se": None, "ours_ahead": None, "ours_ahead_ci95": None}
        if names and len(found) == len(names) and None not in found:
            resampled[method] = np.mean([draws[name, method] for name in names], axis=0)
            means[method] |= {"mean": float(np.mean(found)), "se": float(resampled[method].std())}
    for method in set(resampled) - {OURS} if OURS in resampled else ():
        means[method]["ours_ahead"] = means[OURS]["mean"] - means[method]["mean"]
        means[method]["ours_ahead_ci95"] = interval(resampled[OURS] - resampled[method])
    return means
