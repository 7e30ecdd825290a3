"""Which demonstrations teach: those that are explained best by what the others teach.

A policy of all demonstrations follows the crowd. So the demonstrations are ranked by their mean held-out log-likelihood
of a step, the best of them teach the next policy, and so on: the trimmed likelihood of robust statistics, which is the
paper's robust maximum entropy (eq. 2), with likelihoods of demonstrations that were held out.

    T <- the share h of the demonstrations with the largest  (1 / N_m) sum_n log pi_T(a_n | s_n)

Nobody knows the share of experts. So h starts at `SHARE` and is halved (`shares`) until the scores show two groups.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.fit_data import FitData
from rpil.inference.held_out import Scored, Scorer
from rpil.numerics.types import Array

SHARE = 0.6
"""Of the demonstrations that teach at first; benchmarks/ablations.py has others beside it."""

HALVINGS = 3
"""Times that the share is halved: experts may be as few as one demonstration in ten."""

FEWEST_TEACHERS = 5
"""Demonstrations that teach, so that a policy that leaves some out still has others to learn from."""

ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Taught:
    """Where concentration ended.

    Attributes
    ----------
    scored : Scored
        Under policies taught by `teachers`.
    teachers : (M,) bool array
    ridge : float
        A step, chosen by the held-out likelihood of all demonstrations.
    history : (T,) array
        Mean held-out log-likelihood of a teacher's step, each round.
    """

    scored: Scored
    teachers: Array
    ridge: float
    history: Array


def mean_steps(data: FitData, values: Array) -> Array:
    """Means over the steps of each demonstration, (N,) -> (M,)."""
    means: Array = data.sum_steps(values) / data.lengths
    return means


def choose_ridge(data: FitData, scorer: Scorer, possible: Array) -> float:
    """The ridge, a step, that explains the median of the `possible` (M,) demonstrations best, held out.

    The median, because a mean would be decided by the one that is explained worst.
    """
    weight = data.per_step(possible.astype(float))

    def explained(ridge: float) -> float:
        return float(np.median(mean_steps(data, scorer.held_out(weight, ridge).log_prob)[possible]))

    return max(scorer.ridges, key=explained, default=0.0)


def shares(n_demonstrations: int) -> list[float]:
    """Shares of `n_demonstrations` that may teach, from the largest to the smallest."""
    halved = [SHARE / 2**k for k in range(HALVINGS + 1)]
    return halved[:1] + [share for share in halved[1:] if round(share * n_demonstrations) >= FEWEST_TEACHERS]


def concentrate(data: FitData, scorer: Scorer, teachers: Array, ridge: float, share: float) -> Taught:
    """Concentrate on a `share` of the demonstrations, from `teachers` (M,) bool on.

    Labelled experts always teach, labelled adversaries never do.
    """
    n_taught, history = max(2, round(share * data.n_demonstrations)), []
    for rounds_left in range(ROUNDS, -1, -1):
        found = scorer.held_out(data.per_step(teachers.astype(float)), ridge)
        score = mean_steps(data, found.log_prob)
        history.append(float(score[teachers].mean()))
        chosen = best(data, score, n_taught)
        if not rounds_left or (chosen == teachers).all():
            break
        teachers = chosen
    return Taught(found, teachers, ridge, np.array(history))


def taught_by(data: FitData, scorer: Scorer, group: Array, ridge: float) -> Taught:
    """What policies of the demonstrations `group` (indices) say, without concentration."""
    teachers = np.zeros(data.n_demonstrations, dtype=bool)
    teachers[group] = True
    found = scorer.held_out(data.per_step(teachers.astype(float)), ridge)
    return Taught(found, teachers, ridge, np.array([mean_steps(data, found.log_prob)[teachers].mean()]))


def best(data: FitData, score: Array, count: int) -> Array:
    """The `count` demonstrations with the best `score` (M,), labels before scores, (M,) bool."""
    ranked = np.where(data.labels > 0, np.inf, np.where(data.labels < 0, -np.inf, score))
    chosen = np.zeros(len(score), dtype=bool)
    chosen[np.argsort(-ranked, kind="stable")[:count]] = True
    return (chosen & (data.labels >= 0)) | (data.labels > 0)
