"""Folds of demonstrations, and predictions for each fold by what was fitted to the others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.numerics.parallel import in_parallel
from rpil.numerics.types import Array, Float, Int, Num


def deal(data: FitData, n_folds: int, seed: int) -> Int[Array, " M"]:
    """The fold of each demonstration, at random, but the same for the same demonstrations.

    Their order and ids change nothing, nor do names of actions, nor units, order and copies of columns. Folds have
    equally many demonstrations, or one more; with M folds it is a random order.
    """
    actions = np.asarray(data.actions)
    if isinstance(data.space, Discrete):
        actions = np.bincount(actions, minlength=data.space.n)[actions]  # how frequent it is, whatever its name
    root = np.sqrt(np.arange(1, len(actions) + 1) - data.per_step(data.offsets[:-1]))  # steps in another order differ
    by_states, by_actions = (data.mean_steps(root * _largest(v)) for v in (data.features, actions))
    # Rounded, because sums over the same values in another order, or in other units, differ in their last digits.
    order = np.lexsort((np.round(by_states, 6), np.round(by_actions, 6), data.lengths))
    fold = np.empty(len(order), dtype=int)
    fold[order] = np.random.default_rng(seed).permutation(len(order)) % n_folds
    return fold


def _largest(values: Num[Array, "N ..."]) -> Float[Array, " N"]:
    """Of each step, the largest of its columns, in ranges of the column above its mean; constant columns do not count.

    A copy of a column, or another order, changes no largest one.
    """
    largest = np.full(len(values), -np.inf)
    for column in values.reshape(len(values), -1).T:  # one at a time, because a design matrix may be large
        column = column.astype(float)
        span = column.max() - column.min()
        if span > 0:
            np.maximum(largest, (column - column.mean()) / span, out=largest)
    return np.where(np.isfinite(largest), largest, 0.0)


def pieces(data: FitData, n_pieces: int) -> FitData:
    """The steps cut into consecutive pieces, each a demonstration: for data with too few of these to hold one out."""
    offsets = np.unique(np.linspace(0, len(data.actions), n_pieces + 1).astype(int))
    return FitData(data.features, data.actions, offsets, data.space, np.zeros(len(offsets) - 1, dtype=int))


def out_of_fold(
    fold: Int[Array, " N"], predict: Callable[[int, Array], Array], features: Float[Array, "N D"] | None = None
) -> Float[Array, "N ..."]:
    """Predictions for all steps, where `fold` is the fold of each step, and ``predict(k, test)`` are those for the
    steps `test` (N,) bool of fold k by what was fitted to the others; in threads where there are many `features`."""
    tests = [fold == k for k in range(int(fold.max()) + 1)]
    size = np.empty((0, 0)) if features is None else features
    parts = in_parallel(lambda k: predict(k, tests[k]), range(len(tests)), size)
    out = np.empty((len(fold), *parts[0].shape[1:]))
    for test, part in zip(tests, parts, strict=True):
        out[test] = part
    return out
