"""Facts from which no answer learns: how well the next state follows, and who reached the time limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.inference import facts
from rpil.inference.channels import StateScale
from rpil.inference.facts import at_time_limit, dynamics, facts_beside
from rpil.inference.settings import ChannelSettings

SETTINGS = ChannelSettings()


def driven(n=12, steps=60, odd=3, noise=0.01, shift=0.0):
    """States that the action moves; in demonstration `odd` they move at random, and in all with a little noise."""
    rng = np.random.default_rng(0)
    actions = rng.normal(size=(n, steps, 2))
    pushed = actions @ np.array([[1.0, 0.2, 0.0], [0.0, -0.5, 0.3]])
    pushed[odd] = rng.normal(size=(steps, 3)) * pushed.std()
    states = shift + np.cumsum(pushed + noise * rng.normal(size=pushed.shape), axis=1)
    states = np.concatenate([np.full((n, 1, 3), shift), states[:, :-1]], axis=1)
    flat = actions.reshape(-1, 2)
    design = np.column_stack([states.reshape(-1, 3), np.ones(n * steps)])
    return FitData(design, flat, np.arange(n + 1) * steps, Box.around(flat), np.zeros(n, dtype=int))


def measured(data):
    states = StateScale.of(data, np.ones(data.n_demonstrations, dtype=bool), SETTINGS)
    return dynamics(data, data.actions, states, SETTINGS)


def test_the_next_state_follows_least_where_the_action_does_not_move_it():
    found = measured(driven())
    others = np.delete(found, 3)
    assert found.argmin() == 3
    assert found[3] < others.min() - 5 * np.ptp(others)


def test_dynamics_need_no_more_than_the_changes_within_demonstrations():
    found = measured(driven())
    np.testing.assert_allclose(measured(driven(shift=1e4)), found, atol=1e-3)
    data = driven()
    constant = replace(data, features=np.column_stack([np.full(len(data.features), 7.0), data.features]))
    np.testing.assert_allclose(measured(constant), found, atol=1e-6)


def test_dynamics_do_not_depend_on_the_size_of_a_block(monkeypatch):
    found = measured(driven())
    monkeypatch.setattr(facts, "BLOCK_ROWS", 7)
    np.testing.assert_allclose(measured(driven()), found, rtol=1e-9)


def test_dynamics_that_cannot_be_measured():
    data = driven()
    still = replace(data, features=np.ones_like(data.features))
    assert measured(still) is None
    wide = replace(data, features=np.tile(data.features, (1, facts.MAX_COLUMNS // 4)))
    assert measured(wide) is None
    short = replace(data, offsets=np.concatenate([[0, 1], data.offsets[1:]]), labels=np.zeros(13, dtype=int))
    found = measured(short)
    assert found[0] == pytest.approx(np.median(found[1:]))  # a demonstration of one step


@pytest.mark.parametrize(
    ("lengths", "reached"),
    [
        ([5, 9, 9, 9], [0, 1, 1, 1]),
        ([5, 9, 9, 8], None),  # two may be of one length by chance
        ([9, 9, 9, 9], None),
        ([1, 2, 3, 4], None),
    ],
)
def test_time_limit(lengths, reached):
    found = at_time_limit(np.array(lengths))
    assert (found if found is None else found.tolist()) == reached


def test_what_is_not_known_is_left_out():
    data = driven()
    states = StateScale.of(data, np.ones(data.n_demonstrations, dtype=bool), SETTINGS)
    assert list(facts_beside(data, data.actions, states, SETTINGS)) == ["dynamics"]
