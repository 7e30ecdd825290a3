"""Sums over the steps of each demonstration, against loops."""

from __future__ import annotations

import itertools

import numpy as np

from rpil.faults.measured_columns import changes, means
from rpil.faults.still import largest, longest_runs

OFFSETS = np.array([0, 1, 4, 9, 30])
VALUES = np.random.default_rng(0).integers(0, 3, size=(4, 30)).astype(float)
PARTS = [VALUES[:, a:b] for a, b in itertools.pairwise(OFFSETS)]


def test_changes_means_and_largest():
    change = changes(VALUES, OFFSETS)
    expected = [np.diff(part, axis=1, prepend=part[:, :1]) for part in PARTS]
    np.testing.assert_array_equal(change, np.concatenate(expected, axis=1))
    np.testing.assert_allclose(means(VALUES, OFFSETS), [part.mean(axis=1) for part in PARTS])
    top, step = largest(VALUES, OFFSETS)
    np.testing.assert_array_equal(top, [part.max(axis=1) for part in PARTS])
    np.testing.assert_array_equal(step, [part.argmax(axis=1) for part in PARTS])


def longest(column, counts):
    """The run of one value with most steps that count, its first step and its length."""
    best = (-1, 0, 0)
    start = 0
    for t in range(1, len(column) + 1):
        if t == len(column) or column[t] != column[start]:
            weight = int(counts[start + 1 : t].sum())
            best = max(best, (weight, -start, t - start))
            start = t
    return (best[0], -best[1], best[2]) if best[0] > 0 else (0, 0, 1)


def test_longest_runs():
    counts = np.random.default_rng(1).random(VALUES.shape) < 0.7
    stays = changes(VALUES, OFFSETS) == 0
    stays[:, OFFSETS[:-1]] = False
    found = np.stack(longest_runs(stays, lambda c, t: counts[c, t], OFFSETS), axis=2)
    for m, (a, b) in enumerate(itertools.pairwise(OFFSETS)):
        for c in range(len(VALUES)):
            assert tuple(found[m, c]) == longest(VALUES[c, a:b], counts[c, a:b])
