"""Worlds: recorded files, changes of them, simulated cells, and the point mass."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpil
from worlds import recorded
from worlds.recorded import read
from worlds.sequences import KINDS


def save(folder: Path, name: str = "some", leave_out: tuple[str, ...] = (), **other) -> Path:
    """Ten steps of the demonstrations 3, 4, 5 and 7, in another order."""
    arrays = {
        "observations": np.arange(20.0).reshape(10, 2),
        "actions": np.arange(10) % 3,
        "episode_ids": np.repeat([7, 3, 5, 4], [3, 2, 4, 1]),
        "is_good": np.array([1, 0, -1, 1]),
        "episode_quality": np.array([0.4, 0.1, 0.2, 0.3]),
        "demonstrator_ids": np.array([1, 1, 2, 2]),
    } | other
    path = folder / f"{name}.npz"
    np.savez(path, **{key: array for key, array in arrays.items() if key not in leave_out})
    return path


def test_steps_come_in_the_order_of_their_demonstrations(tmp_path):
    world = read(save(tmp_path))
    made = world.demonstrations
    assert made.lengths.tolist() == [2, 1, 4, 3]
    assert made.ids == (0, 1, 2, 3)
    np.testing.assert_array_equal(made.observations[:3, 0], [6, 8, 18])  # steps 3 and 4, then step 9
    np.testing.assert_array_equal(made.actions[-3:], [0, 1, 2])
    np.testing.assert_array_equal(world.is_good, [1, 0, -1, 1])
    np.testing.assert_array_equal(world.quality, [0.4, 0.1, 0.2, 0.3])
    assert world.people == ("1", "1", "2", "2")
    half = world.good_half()
    assert half.is_good.tolist() == [1, 1]
    assert half.demonstrations.lengths.tolist() == [2, 3]
    assert (half.quality.tolist(), half.people) == ([0.4, 0.3], ("1", "2"))


def test_changes_by_hand():
    states, ids, rng = np.arange(12.0).reshape(6, 2), np.array([0, 0, 1, 2, 2, 2]), np.random.default_rng(0)
    actions = np.arange(6)
    wild, _, _ = recorded.wild(states, actions, ids, rng)
    moved = (wild - states) / states.std(axis=0)
    np.testing.assert_allclose(moved, 1000.0 * (ids == 1)[:, None] * np.ones(2))
    rotated, _, _ = recorded.rotated(states, actions, ids, rng)
    scaled = (states - states.mean(axis=0)) / states.std(axis=0)
    np.testing.assert_allclose(rotated @ rotated.T, scaled @ scaled.T, rtol=1e-6)
    wide, _, _ = recorded.noise_columns(states, actions, ids, rng)
    assert wide.shape == (6, 7)
    copied, _, again = recorded.copied(states, actions, ids, rng)
    assert again.tolist() == [*ids, *range(4, 34, 3)]  # 1 by the number of demonstrations, 3
    assert (copied[6:] == states[2]).all()


@pytest.mark.parametrize("name", KINDS)
def test_a_table_holds_the_demonstrations_of_its_true_kind(name):
    made, clean = KINDS[name](0), KINDS[name](0, clean=True)
    found = rpil.read(made.rows, **made.options)
    np.testing.assert_array_equal(found.lengths, made.true.demonstrations.lengths)
    own = np.sort(found.observations, axis=1)  # in which columns come in another order
    np.testing.assert_array_equal(own, np.sort(made.true.demonstrations.observations, axis=1))
    assert found.n_steps == clean.true.demonstrations.n_steps
    assert clean.true.is_good.all()
    assert not clean.bad_steps.any()
