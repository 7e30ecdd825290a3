"""What our judge is compared with: `PEERS[name](observations, actions, groups) -> score (M,)`, higher is more trusted.

None gets the truth. All fit policies on the raw observations, and demonstration m is the m-th smallest
value of `groups`. A peer that is not made for continuous actions raises a `DataError` that says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata, spearmanr
from scipy.stats import t as student
from sklearn.linear_model import Ridge

import peers
from rpil.data.demonstrations import Demonstrations
from rpil.estimators.cloning import BehavioralCloning

KEPT, ROUNDS, N_FOLDS, FREEDOM = 0.6, 3, 5, 4
LEAST = np.log(1e-3)
"""The smallest log-probability of a discrete action: no single step decides about a demonstration."""

WITH_LENGTH = " + length"
"""What the name of a peer ends with when the number of steps is added to its score."""

Array = NDArray[Any]
Peer = Callable[[Array, Array, Array], Array]


def as_demonstrations(observations: Array, actions: Array, groups: Array) -> Demonstrations:
    """The demonstrations in ascending order of their ids."""
    order = np.argsort(groups, kind="stable")
    return Demonstrations.from_groups(observations[order], actions[order], groups[order])


def of_peers(name: str, observations: Array, actions: Array, groups: Array) -> Array:
    """The score of a method of peers.py; RM-ENT trusts half of the demonstrations."""
    data = as_demonstrations(observations, actions, groups)
    task = peers.Task(n_trusted=max(len(data) // 2, 1))
    return np.asarray(peers.METHODS[name](data, task).scores, dtype=float)


def pooled(observations: Array, actions: Array, groups: Array) -> Array:
    """Mean log-likelihood of a demonstration under a policy fitted to the demonstrations of the other folds."""
    data = as_demonstrations(observations, actions, groups)
    return held_out(data, np.ones(len(data), dtype=bool))


def trimmed(observations: Array, actions: Array, groups: Array) -> Array:
    """The same under a policy that is fitted to the best only.

    At first these are all demonstrations; then, three times, the 60 % with the highest scores of the round before.
    """
    data = as_demonstrations(observations, actions, groups)
    best = np.ones(len(data), dtype=bool)
    for _ in range(ROUNDS + 1):
        score = held_out(data, best)
        best = score >= np.quantile(score, 1 - KEPT)
    return score


def held_out(data: Demonstrations, best: Array) -> Array:
    """Mean log-likelihood (M,) of each demonstration under a policy fitted to the `best` (M,) of the other folds."""
    folds = np.random.default_rng(0).permutation(len(data)) % N_FOLDS
    log_prob = (discrete if data.is_discrete else continuous)(data, best[data.groups], folds[data.groups])
    return np.add.reduceat(log_prob, data.offsets[:-1]) / data.lengths


def splits(taught: Array, folds: Array) -> Iterator[tuple[Array, Array]]:
    """For each fold two masks (N,): the steps to fit (all of the other folds where none is), and the held-out steps."""
    for fold in np.unique(folds):
        asked = folds == fold
        teach = taught & ~asked
        yield (teach if teach.any() else ~asked), asked


def discrete(data: Demonstrations, taught: Array, folds: Array) -> Array:
    """Log-likelihood of each step, (N,), under softmax policies."""
    log_prob = np.empty(data.n_steps)
    for teach, asked in splits(taught, folds):
        policy = BehavioralCloning().fit(data, sample_weight=teach.astype(float))
        log_prob[asked] = policy.log_prob(data.observations[asked], data.actions[asked])
    return np.maximum(log_prob, LEAST)


def continuous(data: Demonstrations, taught: Array, folds: Array) -> Array:
    """Log-likelihood of each step, (N,), under ridge regressions with Student errors of one scale for each column."""
    states, actions = (scaled(np.asarray(rows, dtype=float)) for rows in (data.observations, data.actions))
    error = np.empty_like(actions)
    for teach, asked in splits(taught, folds):
        policy = Ridge(1.0).fit(states[teach], actions[teach])
        error[asked] = actions[asked] - policy.predict(states[asked]).reshape(-1, actions.shape[1])
    # 0.741 is the median size of a Student error of scale 1; the second part keeps a perfect fit from being infinite
    scale = np.median(np.abs(error[taught]), axis=0) / 0.741 + 0.03
    return student.logpdf(error, FREEDOM, scale=scale).sum(axis=1)


def scaled(rows: Array) -> Array:
    return (rows - rows.mean(axis=0)) / (rows.std(axis=0) + 1e-9)


def add_length(score: Array, lengths: Array) -> Array:
    """The rank of a score plus the rank of the length, or minus it where the long ones have the lower scores."""
    if len(np.unique(score)) < 2 or len(np.unique(lengths)) < 2:
        return rankdata(score)
    return rankdata(score) + np.sign(spearmanr(score, lengths).statistic) * rankdata(lengths)


def with_length(peer: Peer, observations: Array, actions: Array, groups: Array) -> Array:
    """A peer's score and the number of steps."""
    return add_length(peer(observations, actions, groups), np.unique(groups, return_counts=True)[1])


SINGLE: dict[str, Peer] = {
    "pooled": pooled,
    "trimmed": trimmed,
    "RM-ENT": partial(of_peers, "RM-ENT"),
    "length": partial(of_peers, "length"),
    "paper's recipe": partial(of_peers, "paper's recipe"),
    "cleanlab": partial(of_peers, "cleanlab"),
}
"""Each of these is fitted once; what length adds to the score of the first two is arithmetic."""

LENGTHENED = ("pooled", "trimmed")

PEERS: dict[str, Peer] = SINGLE | {name + WITH_LENGTH: partial(with_length, SINGLE[name]) for name in LENGTHENED}
