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


def test_moves_are_differences_over_a_window_within_a_demonstration():
    rng = np.random.default_rng(0)
    episodes = [(rng.normal(scale=0.003, size=(n, 2)).cumsum(axis=0), [0, 1] * (n // 2)) for n in (300, 400, 500)]
    made = Demonstrations.from_episodes(episodes)
    found = MovedColumns.of(made, SETTINGS)
    assert found.window == 10  # a fortieth of the median length
    for first, end in zip(made.offsets[:-1], made.offsets[1:], strict=True):
        for row in range(first, end):
            move = found.values[min(row + 5, end - 1)] - found.values[max(row - 5, first)]
            assert (found.moves[row] == (np.abs(move) > SETTINGS.least_move)).all()


def column(*values):
    """One column, whose three demonstrations are alike."""
    still = np.zeros((3 * len(values), 1), dtype=bool)
    offsets = np.arange(4) * len(values)
    return MovedColumns(np.tile(np.array(values), 3)[:, None], offsets, 3, still, np.zeros(1, dtype=bool))


def test_a_hand_is_near_its_home_and_returns():
    near = 0.45 * SETTINGS.level
    assert column(0.0, *[near] * 40, *[1.0] * 50, *[near] * 40).closed(SETTINGS)[1]
    assert not column(*[0.0] * 50, *[1.0] * 50).closed(SETTINGS)[1]  # home again in the next demonstration alone


def test_things_move_in_a_larger_share_of_the_rows_of_a_closed_hand():
    closed = np.arange(100) < 10
    moves = np.stack([np.arange(100) % 10 < 1 + 4 * closed, np.zeros(100, dtype=bool)], axis=1)
    found = MovedColumns(np.zeros((100, 2)), np.array([0, 100]), 3, moves, np.zeros(2, dtype=bool))
    assert found.things(closed, SETTINGS).tolist() == [True, False]  # of which the second never moves


def test_a_cut_is_the_corner_of_the_way_between_two_acts():
    up = np.linspace(0, 1, 11)
    way = np.concatenate([np.stack([np.ones(11), up], axis=1), np.stack([1 - up, np.ones(11)], axis=1)[1:]])
    found = MovedColumns(way, np.array([0, 21]), 3, np.zeros((21, 2), dtype=bool), np.zeros(2, dtype=bool))
    closed = (np.arange(21) < 2) | (np.arange(21) > 18)
    assert found.cuts(closed).tolist() == [10]
