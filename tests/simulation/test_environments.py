"""Environments with discrete observations are Gymnasium's own but for these."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from rpil.data.errors import DataError
from rpil.data.spaces import Box, Discrete
from rpil.simulation.rollouts import actions_of, make


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


@pytest.mark.parametrize(
    ("env_id", "message"),
    [
        ("own_worlds:Own-v0", "The environment 'own_worlds:Own-v0' needs the module 'missing_module': install it."),
        ("no_worlds.here:Own-v0", "Gymnasium has no environment 'no_worlds.here:Own-v0'"),
        ("Nowhere-v0", "Gymnasium has no environment 'Nowhere-v0'"),
    ],
)
def test_what_is_missing_is_named(tmp_path, monkeypatch, env_id, message):
    (tmp_path / "own_worlds.py").write_text("import missing_module")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(DataError) as error:
        make(env_id)
    assert str(error.value).startswith(message)
