"""Undoing a fault gives the demonstration back, and its gain is that of the mean squares."""

from __future__ import annotations

import numpy as np
import pytest

from recordings import recording
from rpil.faults.alignment import Frame, maps_of, misfit
from rpil.faults.undo import OF_ROWS, Tried, Weights, plant, scores, undo

ROWS = [np.concatenate(pair, axis=1) for pair in recording(6)]
FRAME = Frame(np.arange(6), 3, 2, np.arange(6) * 0.1, np.linspace(1, 2, 6), np.full(6, np.inf), 10_000)


@pytest.mark.parametrize("kind", OF_ROWS)
def test_what_is_undone_was_there_before(kind):
    again = undo(kind, plant(kind, ROWS[0], 3), 3)
    distance = np.abs(ROWS[0][:, None] - again[None, 20:-20]).max(axis=2).min(axis=0)
    assert distance.max() < (0.1 if kind == "frame rate" else 1e-12)


def test_gains_are_those_of_demonstrations_changed_by_hand():
    moments = [FRAME.moments(x) for x in ROWS]
    maps = maps_of(np.mean([g for g in moments if g is not None], axis=0), FRAME, 1e-4)
    tried = Tried.of(FRAME)
    found = scores(ROWS[0], Weights.of(maps, np.ones(len(maps)), FRAME, tried.pairs), FRAME, tried)
    assert found is not None

    def gain(values):
        return np.log(misfit(maps, moments[0]) / misfit(maps, FRAME.moments(values))).sum() / 2

    changes = {
        ("sign", (1, -1)): ROWS[0] * np.where(np.arange(6) == 1, -1, 1),
        ("exchanged", (3, 5)): ROWS[0][:, [0, 1, 2, 5, 4, 3]],
        ("offset", (4, -1)): ROWS[0] + np.where(np.arange(6) == 4, found[1][4] * FRAME.spread[4], 0),
    }
    for (kind, columns), values in changes.items():
        (h,) = np.flatnonzero((tried.kind == kind) & (tried.columns == columns).all(axis=1))
        np.testing.assert_allclose(found[0][h], gain(values), atol=1e-6)
