"""Environments by their id: the spaces of their actions, and what is said where none can be made."""

from __future__ import annotations

import pytest

from rpil.data.errors import DataError
from rpil.data.spaces import Box, Discrete
from rpil.simulation.rollouts import actions_of, make


def test_spaces_of_actions():
    assert actions_of(make("MountainCar-v0")) == Discrete(3)
    box = actions_of(make("Pendulum-v1"))
    assert isinstance(box, Box)
    assert (box.low, box.high) == (-2, 2)


@pytest.mark.parametrize(
    ("env_id", "message"),
    [
        ("own_worlds:Own-v0", "Gymnasium cannot make 'own_worlds:Own-v0' (ModuleNotFoundError: "),
        ("Nowhere-v0", "Gymnasium cannot make 'Nowhere-v0' (NameNotFound: "),
    ],
)
def test_what_is_missing_is_named(tmp_path, monkeypatch, env_id, message):
    (tmp_path / "own_worlds.py").write_text("import missing_module")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(DataError) as error:
        make(env_id)
    assert str(error.value).startswith(message)
