"""Cuts: which column is a hand, what is a thing, and the corner between two acts."""

from __future__ import annotations

import numpy as np
import pytest

from rpil import Demonstrations
from rpil.segments.find import MovedColumns, SegmentSettings
from worlds.tidying import tidied

SETTINGS = SegmentSettings()


@pytest.mark.parametrize("noise", [0.0, 0.004])
def test_the_hand_is_the_grip_and_things_are_what_it_moves(noise):
    made = tidied("nobody", 20, 0, noise).demonstrations
    found = MovedColumns.of(made, SETTINGS)
    closed, has_hand = found.closed(SETTINGS)
    assert has_hand
    grip = made.observations[:, 2] > 0.5
    assert (closed == grip).mean() > 0.9
    assert np.flatnonzero(found.things(closed, SETTINGS)).tolist() == [3, 4, 5, 6]


def test_a_cut_lies_where_the_hand_turns():
    made = tidied("wrong place", 20, 0)
    found = MovedColumns.of(made.demonstrations, SETTINGS)
    cuts = found.cuts(found.closed(SETTINGS)[0])
    offsets = made.demonstrations.offsets
    for begin in np.flatnonzero(np.diff(made.bad.astype(int)) != 0) + 1:
        if begin not in offsets:
            assert np.abs(cuts - begin).min() <= 4
    assert not np.isin(offsets, cuts).any()


def test_without_a_hand_acts_lie_between_rests():
    one = np.concatenate([np.linspace(0, 1, 40), np.full(30, 1.0), np.linspace(1, 2, 40)])
    made = Demonstrations.from_episodes([(one[:, None] + 0.1 * k, np.zeros((110, 1))) for k in range(3)])
    found = MovedColumns.of(made, SETTINGS)
    closed, has_hand = found.closed(SETTINGS)
    assert not has_hand
    cuts = found.cuts(closed)
    assert len(cuts) == 3
    assert ((cuts - made.offsets[:-1] >= 35) & (cuts - made.offsets[:-1] <= 75)).all()


def test_moves_do_not_reach_over_the_end_of_a_demonstration_and_classes_of_actions_are_no_columns():
    made = Demonstrations.from_episodes([(np.full((20, 1), float(k)), np.zeros((20, 1))) for k in range(4)])
    assert not MovedColumns.of(made, SETTINGS).moves.any()
    rng = np.random.default_rng(0)
    made = Demonstrations.from_episodes([(rng.normal(size=(20, 2)), [0, 1] * 10) for k in range(4)])
    assert MovedColumns.of(made, SETTINGS).values.shape == (80, 2)
