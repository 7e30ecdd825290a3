"""Folds of demonstrations, and predictions for each fold by what was fitted to the others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rpil.data.copies import Copies, digests
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.numerics.parallel import in_parallel
from rpil.numerics.types import Array, Float, Int, Num


def deal(data: FitData, n_folds: int, seed: int) -> Int[Array, " M"]:
    """The fold of each demonstration, at random, but the same for the same demonstrations.

    Their order and ids change nothing, nor do names of actions, nor units, order and copies of columns. Folds have
    equally many demonstrations, or one more; with M folds it is a random order. Copies of a demonstration are in one
    fold, so that nothing is predicted by what was fitted to itself; then there may be fewer folds, one for each
    different demonstration, and larger ones.
    """
    actions = np.asarray(data.actions)
    if isinstance(data.space, Discrete):
        actions = np.bincount(actions, minlength=data.space.n)[actions]  # how frequent it is, whatever its name
    root = np.sqrt(np.arange(1, len(actions) + 1) - data.per_step(data.offsets[:-1]))  # steps in another order differ
    by_states, by_actions = (data.mean_steps(root * _largest(v)) for v in (data.features, actions))
    # Rounded, because sums over the same values in another order, or in other units, differ in their last digits.
    keys = np.array([np.round(by_states, 6), np.round(by_actions, 6), data.lengths])
    order = np.lexsort(keys)
    unit = Copies.of(digests(data.features, data.actions, data.offsets)[order]).place
    sizes, rng = np.bincount(unit), np.random.default_rng(seed)
    fold = np.empty(len(order), dtype=int)
    if len(sizes) == 1 or len(sizes) == len(order):  # nothing but copies cannot be told apart by any folds
        fold[order] = rng.permutation(len(order)) % n_folds
    else:
        fold[order] = _balanced(sizes, n_folds, rng)[unit]
    return fold


def _balanced(sizes: Int[Array, " U"], n_folds: int, rng: np.random.Generator) -> Int[Array, " U"]:
    """The fold of each unit of so many demonstrations: at random, but the largest units first, to the smallest fold."""
    units = rng.permutation(len(sizes))
    fold = np.empty(len(sizes), dtype=int)
    if n_folds >= len(sizes):
        return units
    load = np.zeros(n_folds, dtype=int)
    for u in units[np.argsort(-sizes[units], kind="stable")].tolist():
        fold[u] = np.argmin(load)
        load[fold[u]] += sizes[u]
    return fold


def _largest(values: Num[Array, "N ..."]) -> Float[Array, " N"]:
    """For each step the largest of its columns, in ranges of the column above its mean; constant columns do not count.

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
    return FitData(data.features, data.actions, offsets, data.space)


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
