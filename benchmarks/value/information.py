"""The mutual information of states and actions, demonstration by demonstration, by nearest neighbours.

After Kraskov, Stoegbauer and Grassberger (2004) for continuous actions and Ross (2014) for discrete ones, used to
score demonstrations as DemInf does (Hejna et al. 2025). States are reduced to a few principal components first.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree
from scipy.special import digamma

from rpil.data.demonstrations import Demonstrations
from rpil.numerics.types import Array

NEIGHBOURS = 5
COMPONENTS = 8
MAX_STEPS = 6000
"""Of each data set, evenly spaced."""
JITTER = 1e-6
"""Standard deviation that is added to scaled numbers, so that no two steps are the same."""


def information(demonstrations: Demonstrations, seed: int) -> Array:
    """The mean over the steps of each demonstration, (M,), in nats: how well actions and states predict each other."""
    rng = np.random.default_rng(seed)
    n_steps = demonstrations.n_steps
    rows = np.arange(0, n_steps, -(-n_steps // MAX_STEPS))
    states, actions = components(demonstrations.observations[rows]), demonstrations.actions[rows]
    states = states + JITTER * rng.normal(size=states.shape)
    if demonstrations.is_discrete:
        steps = of_classes(states, actions)
    else:
        steps = of_numbers(states, scaled(actions) + JITTER * rng.normal(size=actions.shape))
    owner = np.repeat(np.arange(len(demonstrations)), demonstrations.lengths)[rows]
    count = np.bincount(owner, minlength=len(demonstrations))
    total = np.bincount(owner, steps, minlength=len(demonstrations))
    return np.where(count > 0, total / np.maximum(count, 1), steps.mean())


def of_numbers(states: Array, actions: Array) -> Array:
    """Kraskov's first estimator, step by step, (N,): psi(k) + psi(N) - psi(n_s + 1) - psi(n_a + 1)."""
    both = np.column_stack([states, actions])
    distance = KDTree(both).query(both, NEIGHBOURS + 1, p=np.inf)[0][:, -1]
    counts = [within(part, distance) for part in (states, actions)]
    return digamma(NEIGHBOURS) + digamma(len(both)) - sum(digamma(count + 1) for count in counts)


def of_classes(states: Array, classes: Array) -> Array:
    """Ross's estimator, step by step, (N,): psi(N) + psi(k) - psi(N_class) - psi(m)."""
    distance, own = np.zeros(len(states)), np.zeros(len(states))
    k = np.ones(len(states))
    for each in np.unique(classes):
        rows = np.flatnonzero(classes == each)
        k[rows] = count = max(min(NEIGHBOURS, len(rows) - 1), 1)
        own[rows] = len(rows)
        if len(rows) > 1:
            distance[rows] = KDTree(states[rows]).query(states[rows], count + 1, p=np.inf)[0][:, -1]
    m = np.maximum(within(states, distance) + 1, k)
    return digamma(len(states)) + digamma(k) - digamma(own) - digamma(m)


def within(points: Array, distance: Array) -> Array:
    """The number of other points nearer than `distance` (N,) to each."""
    near = KDTree(points).query_ball_point(points, np.nextafter(distance, 0), p=np.inf, return_length=True)
    return np.maximum(near - 1, 0)


def components(observations: Array) -> Array:
    """The first principal components of the scaled columns."""
    rows = scaled(observations)
    _, _, axes = np.linalg.svd(rows, full_matrices=False)
    return scaled(rows @ axes[:COMPONENTS].T)


def scaled(columns: Array) -> Array:
    """Columns with mean 0 and variance 1; those that never change are 0."""
    spread = columns.std(axis=0)
    return (columns - columns.mean(axis=0)) / np.where(spread > 1e-9, spread, np.inf)
