"""Audits without answers, and draws of answers to them, for benchmarks/answers.py."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

import rpil
from claims import Job, Row
from claims import jobs as claims_jobs
from rpil.data.fit_data import Demonstrators
from rpil.inference.answered import NOBODY, Answered, answer, places_to_ask
from rpil.inference.answers import Answers
from rpil.inference.settings import AnswerSettings
from worlds import Array
from worlds.recorded import read_table
from worlds.simulated import ENVIRONMENTS, grid, of_grid, random_and_shifted

SETTINGS = AnswerSettings()
N_LEFT = 3


# ---- audits without answers ------------------------------------------------------------------------------------------


def recorded_jobs(folder: Path) -> Iterator[Job]:
    """The recorded sets and the good half of each."""
    return (job for job in claims_jobs(folder, 0, 0) if job.kind in ("recorded", "half"))


def table_jobs(folder: Path) -> Iterator[Job]:
    """Tables of people at screens and of agents, in folders of `newkinds`."""
    for path in sorted((folder / "newkinds").glob("*/data.csv")):
        yield Job("new kinds", path.parent.name, partial(read_table, path.parent))


def simulated_jobs() -> Iterator[Job]:
    """Flipped and shifted actions, and half random and half shifted ones."""
    for env, kind, share in grid():
        if kind in ("flip", "shift"):
            yield Job("two policies", "", partial(of_grid, env, kind, share))
    for env, seed in product(ENVIRONMENTS, range(3)):
        yield Job("random and shifted", "", partial(random_and_shifted, env, seed))


def audited(job: Job) -> Row:
    """The audit of a job without answers, and the truth."""
    world = job.make()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        audit = rpil.audit(world.demonstrations)
    pair = [audit.index(other) for other in audit.pair]
    who = Demonstrators.from_names(world.people) if world.people else Demonstrators()
    of_all = {"columns": audit.columns, "log_odds": audit.log_odds, "pair": pair, "who": who}
    of_all |= {"finding": audit.finding, "claimed": audit.claimed}
    return {"kind": job.kind, "name": job.name, "good": world.is_good, "quality": world.quality} | of_all


# ---- answers ---------------------------------------------------------------------------------------------------------


def drawn(good: Array, count: int, rng: np.random.Generator) -> Array | None:
    """`count` demonstrations to label, both sorts among them, or None where too few would be left."""
    known = np.flatnonzero(good >= 0)
    if count > len(known) / 2 or min((good == 1).sum(), (good == 0).sum()) < N_LEFT + 1:
        return None
    while True:
        chosen = rng.choice(known, count, replace=False)
        rest = good[np.setdiff1d(known, chosen)]
        if 0 < good[chosen].sum() < count and min((rest == 1).sum(), (rest == 0).sum()) >= N_LEFT:
            return np.asarray(chosen)


def answered(
    audit: Row,
    answers: Answers,
    settings: AnswerSettings = SETTINGS,
    who: Demonstrators = NOBODY,
    task_of: Array | None = None,
) -> Answered:
    """What answers make of an audit."""
    return answer(audit["columns"], answers, settings, np.arange(len(audit["columns"])), who, task_of)


def labelled(audit: Row, chosen: Array, signs: Array | None = None, settings: AnswerSettings = SETTINGS) -> Answered:
    """The audit with labels of the `chosen`, by default the truth."""
    labels = np.zeros(len(audit["good"]), dtype=int)
    labels[chosen] = 2 * audit["good"][chosen] - 1 if signs is None else signs
    return answered(audit, Answers.of_labels(labels), settings)


def compared(audit: Row) -> Answered | None:
    """The audit with its pair answered by the truth; None where the two are alike."""
    quality = audit["quality"][audit["pair"]] if len(audit["pair"]) == 2 else np.zeros(2)
    if quality[0] == quality[1]:
        return None
    better, worse = audit["pair"] if quality[0] > quality[1] else audit["pair"][::-1]
    none = np.zeros(len(audit["good"]), dtype=int)
    answers = replace(Answers.of_labels(none), pairs=np.array([[better, worse]]))
    return answered(audit, answers)


def rest_of(audit: Row, chosen: Array) -> Array:
    return np.setdiff1d(np.flatnonzero(audit["good"] >= 0), chosen)


def mean(values: Iterable[float]) -> str:
    """A mean with its standard error."""
    found = np.array(list(values), dtype=float)
    found = found[np.isfinite(found)]
    if len(found) < 2:
        return f"{found.mean():.3f}" if len(found) else "none"
    return f"{found.mean():.3f} (standard error {found.std(ddof=1) / np.sqrt(len(found)):.3f}, {len(found)} sets)"


def next_asked(audit: Row, labels: Array, unknown: list[int], settings: AnswerSettings = SETTINGS) -> int:
    """The demonstration whose label is asked for next, none of the `unknown`."""
    is_said = labels != 0
    is_said[unknown] = True
    now = answered(audit, Answers.of_labels(labels), settings).log_odds
    return places_to_ask(audit["log_odds"], now, labels, is_said, settings, 1)[0]


def suggested(audit: Row, count: int, settings: AnswerSettings = SETTINGS) -> Array:
    """The labels that are asked for one after the other, each answered before the next."""
    unknown, chosen = np.flatnonzero(audit["good"] < 0).tolist(), []
    labels = np.zeros(len(audit["good"]), dtype=int)
    for _ in range(count):
        chosen.append(next_asked(audit, labels, unknown, settings))
        labels[chosen[-1]] = 2 * audit["good"][chosen[-1]] - 1
    return np.array(chosen)
