"""Held-out likelihoods of demonstrations: of everybody's policy, of the best, and as confident learning has them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.stats import t as student
from sklearn.linear_model import Ridge

from rpil.data.demonstrations import Demonstrations
from rpil.estimators.cloning import BehavioralCloning
from worlds import Array

KEPT, ROUNDS, N_FOLDS, FREEDOM = 0.6, 3, 5, 4
LEAST = np.log(1e-3)
"""The smallest log-probability of a discrete action: no single step decides about a demonstration."""


def pooled(data: Demonstrations, seed: int) -> Array:
    """Mean log-likelihood of a demonstration under a policy fitted to the demonstrations of the other folds."""
    return held_out(data, np.ones(len(data), dtype=bool), seed)


def trimmed(data: Demonstrations, seed: int) -> Array:
    """The same under a policy that is fitted to the best only: at first to all demonstrations; then, three times, to
    the 60 % with the highest scores of the round before."""
    best = np.ones(len(data), dtype=bool)
    for _ in range(ROUNDS + 1):
        score = held_out(data, best, seed)
        best = score >= np.quantile(score, 1 - KEPT)
    return score


def cleanlab(data: Demonstrations, seed: int) -> Array:
    """Confident learning (Northcutt et al., 2021), by its own package: actions are labels that may be wrong.

    As published: the label quality score on out-of-sample predictions, self-confidence where actions are discrete, and
    else the package's score of numbers, averaged over the columns. Adapted: folds are whole demonstrations, and the
    score of a demonstration is the mean of its steps'.
    """
    from cleanlab import rank, regression

    everybody, folds = np.ones(data.n_steps, dtype=bool), folds_of(data, seed)[data.groups]
    if not data.is_discrete:
        columns = zip(scaled(data.actions).T, errors(data, everybody, folds).T, strict=True)
        quality = [regression.rank.get_label_quality_scores(column, column - error) for column, error in columns]
        return step_mean(data, np.mean(quality, axis=0))
    classes, codes = np.unique(data.actions, return_inverse=True)
    proba = np.empty((data.n_steps, len(classes)))
    for teach, asked in splits(everybody, folds):
        policy = BehavioralCloning().fit(data, sample_weight=teach.astype(float))
        proba[asked] = policy.predict_proba(data.observations[asked])
    return step_mean(data, rank.get_label_quality_scores(codes, proba))


def folds_of(data: Demonstrations, seed: int) -> Array:
    return np.random.default_rng(seed).permutation(len(data)) % N_FOLDS


def step_mean(data: Demonstrations, values: Array) -> Array:
    """Means over the steps of each demonstration, (N,) -> (M,)."""
    return np.add.reduceat(values, data.offsets[:-1]) / data.lengths


def held_out(data: Demonstrations, best: Array, seed: int) -> Array:
    """Mean log-likelihood (M,) of each demonstration under a policy fitted to the `best` (M,) of the other folds."""
    likelihood = discrete if data.is_discrete else continuous
    return step_mean(data, likelihood(data, best[data.groups], folds_of(data, seed)[data.groups]))


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
    error = errors(data, taught, folds)
    # 0.741 is the median size of a Student error of scale 1; the second part keeps a perfect fit from being infinite
    scale = np.median(np.abs(error[taught]), axis=0) / 0.741 + 0.03
    return student.logpdf(error, FREEDOM, scale=scale).sum(axis=1)


def errors(data: Demonstrations, taught: Array, folds: Array) -> Array:
    """What ridge regressions of the other folds are off by, (N, A), in standard deviations of the actions."""
    states, actions = scaled(data.observations), scaled(data.actions)
    error = np.empty_like(actions)
    for teach, asked in splits(taught, folds):
        policy = Ridge(1.0).fit(states[teach], actions[teach])
        error[asked] = actions[asked] - policy.predict(states[asked]).reshape(-1, actions.shape[1])
    return error


def scaled(rows: Array) -> Array:
    rows = np.asarray(rows, dtype=float)
    return (rows - rows.mean(axis=0)) / (rows.std(axis=0) + 1e-9)
