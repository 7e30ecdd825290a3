"""Parts that several peers share: scaled columns, features, and a policy that is linear in them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import LogisticRegression

if TYPE_CHECKING:
    from rpil import Demonstrations

    from ..world import Made

MOST_COLUMNS, N_RANDOM, RIDGE = 30, 64, 1.0
"""Principal components where observations are wider, random features, and the penalty of a policy."""
LEAST, MOST_ITERATIONS = 1e-3, 40
"""The smallest probability of a class, and iterations of a softmax policy."""
DRAWN = 77
"""Of random features, which are the same whatever the seed, so that two peers have the same policy."""


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


def predicted(X: np.ndarray, Y: np.ndarray, discrete: bool, weight: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Actions (N, K), or probabilities of classes, by a policy that is fitted to the weighted `rows`."""
    if not discrete or len(kinds := np.unique(Y[rows].argmax(axis=1))) < 2:
        return X @ policy(X[rows], Y[rows], weight[rows])
    with warnings.catch_warnings():  # as far as it comes in so many iterations
        warnings.simplefilter("ignore", ConvergenceWarning)
        fit = LogisticRegression(max_iter=MOST_ITERATIONS).fit(X[rows], Y[rows].argmax(axis=1), weight[rows])
    share = np.zeros(Y.shape)
    share[:, kinds] = fit.predict_proba(X)
    return share


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
