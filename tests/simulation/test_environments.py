"""Environments with discrete observations or discretised actions are Gymnasium's own but for these."""

from __future__ import annotations

import gymnasium
import numpy as np

from rpil.data.spaces import Box, Discrete
from rpil.simulation.environments import DISCRETISED, actions_of, make


def test_discrete_observations_are_one_hot_rows():
    ours, theirs = make("FrozenLake-v1"), gymnasium.make("FrozenLake-v1")
    row, square = ours.reset(seed=3)[0], theirs.reset(seed=3)[0]
    ended = False
    while not ended:
        np.testing.assert_array_equal(row, np.eye(16)[square])
        row, square, ended = ours.step(2)[0], *theirs.step(2)[:3:2]


def test_discretised_pendulum_takes_the_torque_of_each_choice():
    for choice, torque in enumerate((-2, -1, 0, 1, 2)):
        ours, theirs = make("rpil/DiscretePendulum-v1"), gymnasium.make("Pendulum-v1")
        np.testing.assert_array_equal(ours.reset(seed=6)[0], theirs.reset(seed=6)[0])
        for _ in range(20):
            row, reward, *_ = ours.step(choice)
            observation, wanted, *_ = theirs.step(np.array([torque], np.float32))
            np.testing.assert_array_equal(row, observation)
            assert reward == wanted


def test_spaces_of_actions():
    assert actions_of(make("MountainCar-v0")) == Discrete(3)
    (discretised,) = DISCRETISED
    assert actions_of(make(discretised)) == Discrete(5)
    box = actions_of(make("Pendulum-v1"))
    assert isinstance(box, Box)
    assert (box.low, box.high) == (-2, 2)
