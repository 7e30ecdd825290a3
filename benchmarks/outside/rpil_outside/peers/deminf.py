"""DemInf: mutual information of states and actions, step by step (Hejna et al., arXiv 2502.08623).

As published: Kraskov's estimator by nearest neighbours, averaged over several numbers of them, contributions of steps
clipped at their 1st and 99th percentile, and the mean of a demonstration as its score. Adapted: principal components
take the place of the embeddings of two variational autoencoders, single actions that of chunks, and at most 6,000
steps, evenly spaced, are used. A discrete action is a column for each class.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import KDTree
from scipy.special import digamma

from .common import states, targets

if TYPE_CHECKING:
    from ..world import Made

NEIGHBOURS, COMPONENTS, MOST_STEPS = (5, 6, 7), 8, 6000
JITTER = 1e-4
"""Deviation that is added to scaled numbers, so that no two steps are the same."""


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    data, rng = made.demonstrations, np.random.default_rng(seed)
    rows = np.arange(0, data.n_steps, -(-data.n_steps // MOST_STEPS))
    seen, done = (part[rows] for part in (states(data, COMPONENTS), targets(data)))
    information = contributions(*(part + JITTER * rng.normal(size=part.shape) for part in (seen, done)))
    clipped = np.clip(information, *np.quantile(information, (0.01, 0.99)))
    owner = np.asarray(data.groups)[rows]
    count, total = (np.bincount(owner, each, minlength=len(data)) for each in (None, clipped))
    return np.where(count > 0, total / np.maximum(count, 1), clipped.mean())


def contributions(seen: np.ndarray, done: np.ndarray) -> np.ndarray:
    """psi(k) + psi(N) - psi(n_s + 1) - psi(n_a + 1) of each step, its mean over the numbers of neighbours."""
    both = np.column_stack([seen, done])
    distances = KDTree(both).query(both, max(NEIGHBOURS) + 1, p=np.inf)[0]
    found = []
    for k in NEIGHBOURS:
        radius = np.nextafter(distances[:, k], 0)
        near = [KDTree(part).query_ball_point(part, radius, p=np.inf, return_length=True) for part in (seen, done)]
        found.append(digamma(k) + digamma(len(both)) - sum(digamma(np.maximum(count, 1)) for count in near))
    return np.mean(found, axis=0)
