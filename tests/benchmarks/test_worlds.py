"""Worlds: changes of recorded sets, and tables of sequences."""

import numpy as np
import pytest

import rpil
from worlds import recorded
from worlds.sequences import KINDS


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
