"""Environments with discrete observations are Gymnasium's own but for these."""

from __future__ import annotations

import gymnasium
import numpy as np

from rpil.data.spaces import Box, Discrete
from rpil.simulation.environments import actions_of, make


def test_discrete_observations_are_one_hot_rows():
    ours, theirs = make("FrozenLake-v1"), gymnasium.make("FrozenLake-v1")
    row, square = ours.reset(seed=3)[0], theirs.reset(seed=3)[0]
    ended = False
    while not ended:
        np.testing.assert_array_equal(row, np.eye(16)[square])
        row, square, ended = ours.step(2)[0], *theirs.step(2)[:3:2]


def test_spaces_of_actions():
    assert actions_of(make("MountainCar-v0")) == Discrete(3)
    box = actions_of(make("Pendulum-v1"))
    assert isinstance(box, Box)
    assert (box.low, box.high) == (-2, 2)
