"""Sums over the steps of each demonstration of a block, for all columns at once.

Arrays are (C, T), one column of the recording in a row, so that a demonstration is contiguous. `offsets` (M + 1,) run
from 0 to T, and results are (M, C).
"""

from __future__ import annotations

import numpy as np

from rpil.numerics.types import Array, Bool, Float, Int, Shaped


def changes(values: Float[Array, "C T"], offsets: Int[Array, " _"]) -> Float[Array, "C T"]:
    """x_t - x_(t-1), and 0 at the first step of each demonstration."""
    change = np.empty_like(values)
    np.subtract(values[:, 1:], values[:, :-1], out=change[:, 1:])
    change[:, offsets[:-1]] = 0.0
    return change


def means(values: Float[Array, "C T"], offsets: Int[Array, " _"]) -> Float[Array, "M C"]:
    """Mean over the steps of each demonstration."""
    return np.asarray((np.add.reduceat(values, offsets[:-1], axis=1) / np.diff(offsets)).T)


def largest(values: Float[Array, "C T"], offsets: Int[Array, " _"]) -> tuple[Float[Array, "M C"], Int[Array, "M C"]]:
    """The largest value of each demonstration, and the first step of the demonstration that has it."""
    begins = np.arange(len(values))[:, None] * values.shape[1] + offsets[:-1]
    place = first_largest(values.ravel(), begins.ravel()).reshape(begins.shape)
    return values.ravel()[place].T, (place - begins).T


def first_largest(values: Shaped[Array, " K"], begins: Int[Array, " P"]) -> Int[Array, " P"]:
    """Where the largest value of each part is first; the parts follow one another."""
    top = np.repeat(np.maximum.reduceat(values, begins), np.diff(begins, append=len(values)))
    places = np.flatnonzero(values == top)
    return np.asarray(places[np.searchsorted(places, begins)])


def longest_runs(
    changed: Bool[Array, "C T"], counts: Bool[Array, "C T"], offsets: Int[Array, " _"]
) -> tuple[Int[Array, "M C"], Int[Array, "M C"], Int[Array, "M C"]]:
    """The run without a change that has most steps that count, of each demonstration: the number of these steps, the
    step at which the run begins, and its length."""
    runs, starts, bounds = runs_of(changed, offsets)
    counted = np.append(0, np.cumsum(counts))
    # A run begins with the step that changed, and that step is not counted.
    weight = counted[starts + runs] - counted[starts + 1]
    run = first_largest(weight, bounds).reshape(len(changed), len(offsets) - 1).T
    return weight[run], starts[run] % changed.shape[1] - offsets[:-1, None], runs[run]


def runs_of(changed: Bool[Array, "C T"], offsets: Int[Array, " _"]) -> tuple[Array, Array, Array]:
    """Lengths and first positions, in the flattened array, of all runs without a change; and the number of the first
    run of each column and demonstration. A run ends with its demonstration."""
    changed = changed.copy()
    changed[:, offsets[:-1]] = True
    starts = np.flatnonzero(changed)
    first = np.arange(len(changed))[:, None] * changed.shape[1] + offsets[:-1]
    return np.diff(starts, append=changed.size), starts, np.searchsorted(starts, first.ravel())
