"""Which parts of an action are judged, and how they are scaled."""

from dataclasses import replace

import numpy as np
import pytest

from problems import make_continuous
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.inference.held_out import held_out_model, log_reference
from rpil.inference.parts import ActionScale, judged_parts
from rpil.inference.settings import HeldOutSettings

OFFSETS = np.arange(0, 401, 40)  # ten demonstrations of 40 steps


def moving(seed=0, size=10.0):
    return size * np.random.default_rng(seed).normal(size=400)


def parked(values, tremble=0.0, every=4, seed=1):
    """A value for each demonstration, that trembles in one of so many steps."""
    rng = np.random.default_rng(seed)
    return np.repeat(values, 40) + tremble * rng.normal(size=400) * np.repeat(rng.random(100) < 1 / every, 4)


def gripper(size):
    """From end to end once within each demonstration."""
    return np.tile(np.where(np.arange(40) < 25, 0.0, size), 10)


def judged(*columns):
    return judged_parts(np.column_stack(columns), OFFSETS).tolist()


def test_a_part_is_judged_that_moves_in_more_than_a_tenth_of_the_demonstrations():
    sessions = parked([0.0] * 5 + [3.0] * 5)
    assert judged(moving(), sessions, parked(np.zeros(10))) == [True, False, False]
    mostly = sessions.copy()
    mostly[:40] += moving(2)[:40]
    assert judged(moving(), mostly) == [True, False]
    mostly[40:80] += moving(2)[40:80]
    assert judged(moving(), mostly) == [True, True]


def test_a_part_that_trembles_rests_beside_parts_that_move():
    assert judged(moving(), moving(3), parked(np.arange(10.0), tremble=0.02)) == [True, True, False]
    assert judged(parked(np.arange(10.0), tremble=0.02)) == [True]  # nothing moves more


@pytest.mark.parametrize("size", [0.04, 1.0, 255.0])
def test_a_gripper_is_judged_in_any_unit(size):
    assert judged(moving(), moving(3), gripper(size), moving(4, size=1e-4 * size)) == [True] * 4


def data_of(actions, judged=None):
    space = Box.around(actions)
    return FitData(np.ones((len(actions), 1)), actions, OFFSETS, space, np.zeros(10, dtype=int), judged=judged)


def test_actions_are_scaled_by_their_motion_within_demonstrations():
    levels = np.repeat(100.0 * np.arange(10), 40) + moving(size=2.0)
    scale = ActionScale.of(data_of(levels[:, None]))
    assert scale.spread == pytest.approx(2.0, rel=0.1)
    np.testing.assert_allclose(scale.back(scale(levels[:, None])), levels[:, None])


def test_one_wild_demonstration_changes_no_scale_and_is_cut_off():
    actions = np.column_stack([moving(), gripper(1.0), parked([0.0] * 4 + [1.0] * 6)])
    wild = actions.copy()
    wild[:40] += 1e4
    one, other = ActionScale.of(data_of(actions)), ActionScale.of(data_of(wild))
    np.testing.assert_allclose(other.spread, one.spread, rtol=0.2)
    assert np.abs(other(wild)[40:] - one(actions)[40:]).max() < 1.0
    assert np.abs(other(wild)).max() < 130  # of 10,000


def test_what_rests_changes_neither_scores_nor_reference():
    problem = make_continuous("random", 0, steps=(40, 60)).problem()
    n, keep = len(problem.actions), np.array([True] * problem.actions.shape[1] + [False])
    resting = np.random.default_rng(0).normal(size=(n, 1))
    more = replace(problem, actions=np.hstack([problem.actions, resting]), judged=keep)
    settings, everyone = HeldOutSettings(), np.ones(problem.n_demonstrations, dtype=bool)
    gains = []
    for data in (problem, more):
        model = held_out_model(problem, settings)
        model = replace(model, data=data)
        gains.append(model.evaluate(np.ones(n), 1e-2) - log_reference(data, everyone, settings))
    np.testing.assert_allclose(*gains, atol=1e-9)
