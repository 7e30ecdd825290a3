"""Folds of demonstrations, and predictions for each fold by what was fitted to the others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rpil.data.fit_data import FitData
from rpil.numerics.parallel import in_parallel
from rpil.numerics.regression import standardise
from rpil.numerics.types import Array, Float, Int


def deal(data: FitData, n_folds: int, seed: int) -> Int[Array, " M"]:
    """The fold of each demonstration, at random, but the same for a demonstration wherever it stands in the data.

    Folds have equally many demonstrations, or one more; with M folds it is a random order.
    """
    keys = data.sum_steps(np.asarray(data.features, dtype=float)).sum(axis=1)
    columns = standardise(np.asarray(data.actions, dtype=float).reshape(len(data.actions), -1))
    actions = data.sum_steps(columns).sum(axis=1)
    # Rounded, because sums over the same values in another order differ in their last digits.
    order = np.lexsort((np.round(keys, 6), np.round(actions, 6), data.lengths))
    fold = np.empty(len(order), dtype=int)
    fold[order] = np.random.default_rng(seed).permutation(len(order)) % n_folds
    return fold


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
