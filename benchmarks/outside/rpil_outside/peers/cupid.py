"""CUPID's formula: the influence of a demonstration on the return, by influence functions (arXiv 2506.19121).

As published: the mean over rollouts of R times the sum, over the steps of rollout and demonstration, of
grad log pi' H^-1 grad log pi. Adapted: no rollouts are at hand, so the demonstrations themselves stand for them, with
the recorded flag as R less its mean, or where all succeeded eight answers; what a demonstration does to its own return
is left out. The policy is linear in its parameters with normal errors, of which H is exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from .common import RIDGE, NotMadeForIt, design, policy, targets, told

if TYPE_CHECKING:
    from ..world import Made

N_ANSWERS = 8


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    data, X, Y = made.demonstrations, design(made.demonstrations), targets(made.demonstrations)
    error = Y - X @ policy(X, Y)
    slopes = np.stack([X[a:b].T @ error[a:b] for a, b in zip(data.offsets[:-1], data.offsets[1:], strict=True)])
    solved = np.linalg.solve(X.T @ X + RIDGE * np.eye(X.shape[1]), slopes)
    returns = centred(made, answers)
    of_all = np.tensordot(returns, solved, axes=1)
    own = returns * (slopes * solved).sum(axis=(1, 2))
    return ((slopes * of_all).sum(axis=(1, 2)) - own) / data.lengths


def centred(made: Made, answers: Mapping[str, bool]) -> np.ndarray:
    """Returns (M,) less their mean, 0 where none is known."""
    at, good = told(made, answers)
    if made.success is not None and np.ptp(np.asarray(made.success, dtype=float)):
        at, good = np.arange(len(made.success)), np.asarray(made.success, dtype=float)
    if not len(at):
        raise NotMadeForIt("neither failures nor answers are known")
    returns = np.zeros(len(made.demonstrations))
    returns[at] = good - np.mean(good) if np.ptp(good.astype(float)) else 2.0 * good - 1
    return returns
