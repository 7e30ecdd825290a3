"""Actions and the states that go with them: by their names, by what follows best, and the lag between them."""

from __future__ import annotations

import numpy as np
import pytest

from recordings import recording
from rpil import Demonstrations
from rpil.data.episodes import lay_end_to_end
from rpil.faults.rule import Learned
from rpil.faults.tracking import relation

CLEAN = recording(8, joints=4)


def learned(episodes, states=(), actions=()):
    observations, every, offsets, *_ = lay_end_to_end(episodes, None, "x")
    made = Demonstrations(observations, every, offsets, observation_names=states, action_names=actions)
    return Learned.of(made)


def test_pairs_are_those_of_the_same_name_in_any_order_and_without_names_what_follows_best():
    shuffled = [(x[:, [2, 0, 3, 1]], a) for x, a in CLEAN]
    states = ("state.c", "state.a", "state.d", "state.b")
    tracked = learned(shuffled, states, ("action.a", "action.b", "action.c", "action.d")).tracked
    assert (tracked.action.tolist(), tracked.state.tolist()) == ([4, 5, 6, 7], [1, 3, 0, 2])
    assert (tracked.lag, tracked.is_command, tracked.fits.all()) == (2, True, True)
    episodes = [(np.c_[x[:, :1] ** 2, x[:, [2, 0, 3, 1]]], a) for x, a in CLEAN]
    tracked = learned(episodes, ("p", "q", "r", "s", "t"), ("a", "b", "c", "d")).tracked
    assert (tracked.action.tolist(), tracked.state.tolist()) == ([5, 6, 7, 8], [2, 4, 1, 3])


def test_a_relation_is_a_slope_a_correlation_and_the_better_partner():
    rng = np.random.default_rng(0)
    states = np.cumsum(rng.normal(size=(3, 300)), axis=1)
    slope, share, best, mine, other = (
        of[0] for of in relation([(states[[1, 0, 2]] * [[1], [1], [-2]], states)], False)
    )
    assert best.tolist()[:2] == [1, 0]
    assert slope[2] == pytest.approx(-2)
    assert share[2] == pytest.approx(1)
    np.testing.assert_allclose(other[:2], 0, atol=1e-9)
    assert (mine[:2] > 0.1).all()


def test_an_action_that_stays_far_from_states_of_many_counts_is_related_to_none():
    states = 1e5 + np.cumsum(np.ones((2, 300)), axis=1)
    with np.errstate(over="raise"):
        _, share, _, mine, _ = relation([(np.zeros((2, 300)), states)], True)
    assert (share == 0).all()
    assert np.isfinite(mine).all()
