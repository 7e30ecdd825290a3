"""Parts that several peers share: scaled columns, a policy that is linear in features, and one of trees."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from sklearn.ensemble import ExtraTreesRegressor

if TYPE_CHECKING:
    from rpil import Demonstrations

    from ..world import Made

MOST_COLUMNS, N_RANDOM, RIDGE = 30, 256, 1.0
"""Principal components where observations are wider, random features, and the penalty of a policy."""
LEAST, N_TREES, LEAF = 1e-3, 20, 10
"""The smallest probability of a class; trees of a policy, and steps of each of their leaves at least."""
DRAWN = 77
"""Of random features and trees, which are the same whatever the seed, so that two peers have the same policy."""


class NotMadeForIt(Exception):
    """Says why a method gives no score for these demonstrations."""


def scaled(rows: np.ndarray) -> np.ndarray:
    """Columns with mean 0 and variance 1; those that never change are 0."""
    rows = np.asarray(rows, dtype=float)
    spread = rows.std(axis=0)
    return (rows - rows.mean(axis=0)) / np.where(spread > 1e-9, spread, np.inf)


def states(data: Demonstrations, most: int = MOST_COLUMNS) -> np.ndarray:
    """Scaled observations (N, D), or their first principal components where there are more than `most`."""
    rows = scaled(np.nan_to_num(data.observations))
    if rows.shape[1] <= most:
        return rows
    axes = np.linalg.eigh(rows.T @ rows)[1][:, ::-1]
    return scaled(rows @ axes[:, :most])


def targets(data: Demonstrations) -> np.ndarray:
    """Actions (N, K): scaled numbers, or a column of 0 and 1 for each class."""
    if not data.is_discrete:
        return scaled(data.actions)
    classes, codes = np.unique(data.actions, return_inverse=True)
    return np.eye(len(classes))[codes.ravel()]


def design(data: Demonstrations) -> np.ndarray:
    """A constant, the states, and random rectified mixtures of them, (N, P)."""
    seen = states(data)
    rng = np.random.default_rng(DRAWN)
    mixed = seen @ rng.normal(size=(seen.shape[1], N_RANDOM)) / np.sqrt(max(seen.shape[1], 1)) + rng.normal(
        size=N_RANDOM
    )
    return np.column_stack([np.ones(len(seen)), seen, scaled(np.maximum(mixed, 0.0))])


def policy(X: np.ndarray, Y: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """Coefficients (P, K) of least squares with a ridge."""
    weighted = X if weight is None else X * weight[:, None]
    return np.linalg.solve(X.T @ weighted + RIDGE * np.eye(X.shape[1]), weighted.T @ Y)


def predicted(seen: np.ndarray, Y: np.ndarray, weight: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
    """Actions (N, K), or probabilities of classes, by trees that learn the weighted `rows`, or all: not linear."""
    rows = np.arange(len(Y)) if rows is None else rows
    trees = ExtraTreesRegressor(N_TREES, min_samples_leaf=LEAF, random_state=DRAWN)
    return trees.fit(seen[rows], Y[rows], weight[rows]).predict(seen).reshape(Y.shape)


def likelihood(Y: np.ndarray, predicted: np.ndarray, discrete: bool, weight: np.ndarray | None = None) -> np.ndarray:
    """pi(a|s) of each step, (N,): a probability, or a normal density over its highest value."""
    if discrete:
        share = np.clip(predicted, LEAST, None)
        return (share * Y).sum(axis=1) / share.sum(axis=1)
    return np.exp(-0.5 * (((Y - predicted) / spreads(Y, predicted, weight)) ** 2).sum(axis=1))


def by_chance(Y: np.ndarray, predicted: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The normal density of all scaled actions, over that of the policy at its mean, (N,)."""
    return np.exp(np.log(spreads(Y, predicted, weight)).sum() - 0.5 * (Y**2).sum(axis=1))


def spreads(Y: np.ndarray, predicted: np.ndarray, weight: np.ndarray | None) -> np.ndarray:
    """Deviations of the policy's errors, one for each column."""
    return np.sqrt(np.average((Y - predicted) ** 2, axis=0, weights=weight)) + 0.01


def mean_of(data: Demonstrations, values: np.ndarray) -> np.ndarray:
    """Means over the steps of each demonstration: (N,) to (M,), (N, K) to (M, K)."""
    lengths = data.lengths if values.ndim == 1 else data.lengths[:, None]
    return np.add.reduceat(values, data.offsets[:-1], axis=0) / lengths


def told(made: Made, answers: Mapping[str, bool]) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the demonstrations that were answered, and whether each is good."""
    place = {str(name): m for m, name in enumerate(made.demonstrations.ids)}
    return np.array([place[name] for name in answers], dtype=int), np.array(list(answers.values()), dtype=bool)
