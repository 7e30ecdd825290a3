"""Sentences about parts of the action that rest."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.results.resting import not_judged, resting_names, resting_sessions

OFFSETS = np.arange(0, 401, 40)  # ten demonstrations of 40 steps
MOVING = 10 * np.random.default_rng(0).normal(size=400)


def parked(values):
    """A value for each demonstration."""
    return np.repeat(values, 40)


def test_names_are_folded_where_all_of_a_prefix_rests():
    names = ["actions.left.1", "actions.left.2", "actions.right.1", "actions.right.2", "actions.right.3"]
    moves = np.array([False, False, True, False, True])
    assert resting_names(moves, names) == "actions.left.*, actions.right.2"
    said = "not judged: 3 of 5 parts of the action, which rest: actions.left.*, actions.right.2"
    assert not_judged(moves, names) == said
    assert not_judged(np.array([True, False])) == "not judged: 1 of 2 parts of the action, which rest: 1"
    assert not_judged(np.array([True])) == ""


def test_sessions_are_the_groups_of_resting_values():
    values = np.array([0.0, 0.0, 5.0, 5.1, 5.0, -3.0, -3.0, 0.1, 0.0, 5.0])
    actions = np.column_stack([MOVING, parked(values), parked(np.zeros(10))])
    found = resting_sessions(actions, OFFSETS, np.array([True, False, False]))
    assert {part: [group.tolist() for group in groups] for part, groups in found.items()} == {
        1: [[5, 6], [0, 1, 7, 8], [2, 3, 4, 9]]
    }


@pytest.mark.parametrize("values", [np.arange(10.0), [0.0] * 9 + [5.0]], ids=["evenly", "one alone"])
def test_no_sessions(values):
    actions = np.column_stack([MOVING, parked(np.asarray(values))])
    assert resting_sessions(actions, OFFSETS, np.array([True, False])) == {}
