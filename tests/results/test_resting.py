"""Sentences about parts of the action that rest, and about the sessions that they tell apart."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.results.resting import resting_sentences

MOVING = 10 * np.random.default_rng(0).normal(size=400)
NAMES = ("actions.left.1", "actions.left.2", "actions.right.1", "actions.right.2", "actions.right.3")


def sentences(judged, *resting, names=()):
    """Of ten demonstrations of 40 steps; parts that are not judged rest at a value in each demonstration."""
    values = iter(resting)
    columns = [MOVING if moves else np.repeat(next(values, np.zeros(10)), 40) for moves in judged]
    actions, offsets = np.column_stack(columns), np.arange(0, 401, 40)
    box = Box(actions.min(axis=0), actions.max(axis=0))
    data = FitData(np.ones((400, 1)), actions, offsets, box, np.zeros(10), judged=np.array(judged), action_names=names)
    return [*resting_sentences(data, range(10))]


def test_names_are_folded_where_all_of_a_prefix_rests():
    said = "Not judged: 3 of 5 parts of the action, which rest: actions.left.*, actions.right.2."
    assert sentences([False, False, True, False, True], names=NAMES) == [said]
    assert sentences([True, False]) == ["Not judged: 1 of 2 parts of the action, which rest: 1."]
    assert sentences([True]) == []


def test_sessions_are_the_groups_of_resting_values():
    values = np.array([0.0, 0.0, 5.0, 5.1, 5.0, -3.0, -3.0, 0.1, 0.0, 5.0])
    said = "1 rests elsewhere in 5, 6; 0, 1, 7, 8 than in the others: a session or a set-up."
    assert sentences([True, False, False], values)[1:] == [said]


@pytest.mark.parametrize("values", [np.arange(10.0), [0.0] * 9 + [5.0]], ids=["evenly", "one alone"])
def test_no_sessions(values):
    assert len(sentences([True, False], values)) == 1
