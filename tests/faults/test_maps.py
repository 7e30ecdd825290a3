"""Undoing a fault gives the demonstration back, and its gain is that of the mean squares."""

from __future__ import annotations

import numpy as np
import pytest

from recordings import recording
from rpil.faults.maps import OF_ROWS, Frame, Tried, gains, maps_of, misfit, undo

ROWS = [np.concatenate(pair, axis=1) for pair in recording(6)]
FRAME = Frame(np.arange(6), 3, 2, np.zeros(6), np.linspace(1, 2, 6), 10_000)


@pytest.mark.parametrize("kind", OF_ROWS)
def test_what_is_undone_was_there_before(kind):
    again = undo(kind, undo(OF_ROWS[kind], ROWS[0], 3), 3)
    distance = np.abs(ROWS[0][:, None] - again[None, 20:-20]).max(axis=2).min(axis=0)
    assert distance.max() < (0.1 if kind == "frame rate" else 1e-12)


def test_gains_are_those_of_demonstrations_changed_by_hand():
    moments = [g for x in ROWS if (g := FRAME.moments(x)) is not None]
    maps = maps_of(np.mean(moments, axis=0), FRAME, 1e-4)
    tried = Tried.of(FRAME)
    found = gains(ROWS[0], moments[0], maps, FRAME, tried)
    changes = {
        ("sign", (1, -1)): ROWS[0] * np.where(np.arange(6) == 1, -1, 1),
        ("exchanged", (3, 5)): ROWS[0][:, [0, 1, 2, 5, 4, 3]],
        ("reversed", (-1, -1)): ROWS[0][::-1],
    }
    for (kind, columns), values in changes.items():
        (h,) = np.flatnonzero((tried.kind == kind) & (tried.columns == columns).all(axis=1))
        gain = np.log(misfit(maps, moments[0]) / misfit(maps, FRAME.moments(values))).sum() / 2
        np.testing.assert_allclose(found[h], gain, atol=1e-6)
