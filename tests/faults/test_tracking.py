"""Actions and the states that go with them: by their names, by what follows best, and the lag between them."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from recordings import recording
from rpil import Demonstrations
from rpil.data.episodes import lay_end_to_end
from rpil.faults.rule import Learned
from rpil.faults.tracking import Tracked, misfits, relation, squared_correlation

CLEAN = recording(8, joints=4)


def learned(episodes, states=(), actions=()):
    observations, every, offsets, *_ = lay_end_to_end(episodes, None, "x")
    made = Demonstrations(observations, every, offsets, observation_names=states, action_names=actions)
    return Learned.of(made)


def test_pairs_are_those_of_the_same_name_in_any_order_and_without_names_what_follows_best():
    shuffled = [(np.c_[x[:, [2, 0, 3, 1]], x[:, 1] ** 2], a) for x, a in CLEAN]
    states = ("state.c", "state.a", "state.d", "state.b", "measured.a")  # of one name, the first
    tracked = learned(shuffled, states, ("action.a", "action.b", "action.c", "action.d")).tracked
    assert (tracked.action.tolist(), tracked.state.tolist()) == ([5, 6, 7, 8], [1, 3, 0, 2])
    assert (tracked.lag, tracked.is_command, tracked.fits.all()) == (2, True, True)
    episodes = [(np.c_[x[:, :1] ** 2, x[:, [2, 0, 3, 1]]], a) for x, a in CLEAN]
    tracked = learned(episodes, ("p", "q", "r", "s", "t"), ("a", "b", "c", "d")).tracked
    assert (tracked.action.tolist(), tracked.state.tolist()) == ([5, 6, 7, 8], [2, 4, 1, 3])


def test_a_relation_is_a_slope_a_correlation_and_the_better_partner():
    rng = np.random.default_rng(0)
    states = 1e-3 * np.cumsum(rng.normal(size=(3, 300)), axis=1)
    actions = states[[1, 0, 2]] * [[1], [1], [-2]] + 1e-3 * (rng.normal(size=(3, 300)) + 4)
    related = np.corrcoef(actions, states)[:3, 3:]
    np.testing.assert_allclose(squared_correlation(actions, states), related**2)
    for is_command in (False, True):
        slope, share, best, mine, other = (of[0] for of in relation([(actions, states)], is_command))
        assert best.tolist()[:2] == [1, 0]
        np.testing.assert_allclose(slope, np.sign(np.diag(related)) * actions.std(axis=1) / states.std(axis=1))
        np.testing.assert_allclose(share, np.diag(related) ** 2)
        apart = ((actions[:, None] - states) ** 2).mean(axis=2) / actions.var(axis=1)[:, None]
        left = apart if is_command else 1 - related**2
        np.testing.assert_allclose(mine, np.diag(left))
        np.testing.assert_allclose(other, (left + np.diag([np.inf] * 3)).min(axis=1))


@pytest.mark.parametrize("lengths", [[70, 9, 1, 13, 4, 31], [5, 3]])
def test_misfits_are_what_is_left_of_commands_at_each_lag(lengths):
    rng, offsets, fits = np.random.default_rng(0), np.cumsum([0, *lengths]), np.arange(20) != 1
    values, spread, slope = rng.normal(size=(40, offsets[-1])), rng.uniform(1, 2, 40), rng.normal(size=20)
    values[20:] += np.roll(values[:20], -2, axis=1) * 3 + 5
    block = SimpleNamespace(values=values, offsets=offsets, columns=SimpleNamespace(spread=spread))
    found = misfits(block, Tracked(np.arange(20, 40), np.arange(20), slope, fits))
    first = np.flatnonzero(fits)[:16]  # pairs tell as much as all
    for m, (begin, end) in enumerate(itertools.pairwise(offsets)):
        own = values[:, begin:end] / np.tile(spread[20:], 2)[:, None]
        actions, states = own[20:][first], (own[:20] * slope[:, None])[first]
        for lag, found_left in zip(range(-10, 11), found[m], strict=True):
            n, left = end - begin - abs(lag), np.inf
            if n >= 3 or lag == 0:
                apart = actions[:, max(-lag, 0) :][:, :n] - states[:, max(lag, 0) :][:, :n]
                left = apart.var(axis=1).sum() / max(actions.var(axis=1).sum(), 1e-12)
            assert found_left == pytest.approx(left, abs=1e-9)


def test_an_action_that_stays_far_from_states_of_many_counts_is_related_to_none():
    states = 1e5 + np.cumsum(np.ones((2, 300)), axis=1)
    with np.errstate(over="raise"):
        _, share, _, mine, _ = relation([(np.zeros((2, 300)), states)], True)
    assert (share == 0).all()
    assert np.isfinite(mine).all()
