"""QoQ, Quality over Quantity: how much a step lowers the loss of validation steps (arXiv 2603.09056).

As published: influence functions; of a training step the largest influence on any validation step; the mean over the
steps of a demonstration. Adapted: the policy is linear in its parameters, of which H is exact; the good ones of eight
answers are the validation set, at most 600 of their steps, and without a good one all demonstrations are. A step has
no influence on its own demonstration. The largest of many is large where errors are: noisy ones can come first.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from .common import RIDGE, design, mean_of, policy, targets, told

if TYPE_CHECKING:
    from ..world import Made

N_ANSWERS, MOST_VALIDATION, BLOCK = 8, 600, 4000


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    data, X, Y = made.demonstrations, design(made.demonstrations), targets(made.demonstrations)
    error, owner = Y - X @ policy(X, Y), np.asarray(data.groups)
    at, good = told(made, answers)
    steps = np.flatnonzero(np.isin(owner, at[good])) if good.any() else np.arange(data.n_steps)
    steps = steps[np.linspace(0, len(steps) - 1, min(len(steps), MOST_VALIDATION)).astype(int)]
    solved = np.linalg.solve(X.T @ X + RIDGE * np.eye(X.shape[1]), X[steps].T)
    most = np.empty(data.n_steps)
    for begin in range(0, data.n_steps, BLOCK):
        rows = slice(begin, begin + BLOCK)
        influence = (X[rows] @ solved) * (error[rows] @ error[steps].T)
        most[rows] = np.where(owner[rows, None] == owner[steps], -np.inf, influence).max(axis=1)
    return mean_of(data, np.where(np.isfinite(most), most, 0.0))
