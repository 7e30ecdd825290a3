"""Undoing a fault gives the demonstration back, and its gain is that of the mean squares."""

from __future__ import annotations

import numpy as np
import pytest

from recordings import recording
from rpil.faults.maps import OF_ROWS, Level, Namer, Window, gains, maps_of, misfit, undo

ROWS = [np.concatenate(pair, axis=1) for pair in recording(6)]
FRAME = Window(np.arange(6), 3, 2, np.zeros(6), np.linspace(1, 2, 6))


@pytest.mark.parametrize("kind", OF_ROWS)
def test_what_is_undone_was_there_before(kind):
    again = undo(kind, undo(OF_ROWS[kind], ROWS[0], 3), 3)
    distance = np.abs(ROWS[0][:, None] - again[None, 20:-20]).max(axis=2).min(axis=0)
    assert distance.max() < (0.1 if kind == "frame rate" else 1e-12)


def test_gains_are_those_of_demonstrations_changed_by_hand():
    moments = [g for x in ROWS if (g := FRAME.moments(x)) is not None]
    maps = maps_of(np.mean(moments, axis=0), FRAME, 1e-4)
    kinds, columns = FRAME.tried
    found = gains(ROWS[0], moments[0], maps, FRAME)
    changes = {
        ("sign", 1): ROWS[0] * np.where(np.arange(6) == 1, -1, 1),
        ("sign", 4): ROWS[0] * np.where(np.arange(6) == 4, -1, 1),
        ("doubled rate", -1): ROWS[0][::2],
    }
    for (kind, column), values in changes.items():
        (h,) = np.flatnonzero((kinds == kind) & (columns == column))
        gain = np.log(misfit(maps, moments[0]) / misfit(maps, FRAME.moments(values))).sum() / 2
        np.testing.assert_allclose(found[h], gain, atol=1e-6)


def test_a_demonstration_that_is_too_short_without_every_other_step_gains_nothing_by_it():
    short = ROWS[0][:10]
    moments = FRAME.moments(short)
    maps = maps_of(np.mean([FRAME.moments(x) for x in ROWS], axis=0), FRAME, 1e-4)
    gain = gains(short, moments, maps, FRAME)
    assert gain[FRAME.tried[0][: len(gain)] == "doubled rate"] == 0
    assert FRAME.moments(short[:9]) is None


def test_columns_reach_as_far_as_the_variance_of_the_others_tells(monkeypatch):
    maps = np.hstack([np.eye(6), np.zeros((6, 12))])
    level = Level(np.zeros(6), np.ones(6), np.inf)
    namer = Namer(FRAME, maps[None], np.full(6, 1e-9), np.full((1, 6), 16.0), level, np.full(16, -1e9), 1e9, -np.inf)
    for place in FRAME.places[:, 1]:
        for variance, within in ((15.99, True), (16.01, False)):
            moments = np.eye(18)
            moments[place, place] = variance
            monkeypatch.setattr(Window, "moments", lambda *_, moments=moments: moments)
            assert (namer.name(0, ROWS[0]) != (0, 0.0)) == within


def test_constant_of_a_column_is_found_among_levels():
    rng, column = np.random.default_rng(0), np.array([[1.0, 0.0], [0.5, 1.0], [0.0, 2.0]])
    level = Level.of(rng.normal(size=(200, 3)) * [1, 2, 3] + 5)
    off = np.array([5.0, 5, 5]) + 8 * column[:, 0]
    gain = level.gains(off, column)
    assert gain.argmax() == 0
    np.testing.assert_allclose(gain[0], 64 / 2 * level.power(column)[0], rtol=0.1)
    assert abs(level.excess(off) - gain[0]) < 1 < level.rest
