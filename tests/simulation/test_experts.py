"""The closed-form experts: their formulas, and the returns that they are used for."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from gymnasium.envs.box2d.lunar_lander import heuristic

from rpil.data.errors import DataError
from rpil.simulation.experts import expert
from rpil.simulation.rollouts import record, rollout

# Hanging and swinging to either side, upright and falling to either side, then anywhere.
ANGLES = np.concatenate([[np.pi, np.pi, 0.1, -0.1], np.random.default_rng(4).uniform(-np.pi, np.pi, 3000)])
SPEEDS = np.concatenate([[-1.0, 1.0, 1.0, -1.0], np.random.default_rng(5).normal(size=3000)])


@pytest.mark.parametrize(
    ("env_id", "mean", "sd"),
    [
        ("MountainCar-v0", -102.7, 13.7),
        # The long-run sd is 42 because one episode in a thousand never swings up.
        ("Acrobot-v1", -90.4, 42),
        ("LunarLander-v3", 235, 113),
        ("Pendulum-v1", -152, 90),
        ("MountainCarContinuous-v0", 95.1, 1.1),
        ("LunarLanderContinuous-v3", 283, 28),
    ],
)
def test_return_is_the_documented_one(env_id, mean, sd):
    seen = rollout(expert(env_id), env_id, n_episodes=30, seed=0)
    # Three standard errors of 30 episodes around the mean of 1,000.
    assert abs(seen.mean - mean) < 3 * sd / np.sqrt(30)


LEAST = {"MountainCar-v0": -199, "Acrobot-v1": -499, "CartPole-v1": 500}
LEAST |= {"Pendulum-v1": -600, "MountainCarContinuous-v0": 90, "LunarLanderContinuous-v3": 200}


@pytest.mark.parametrize(("env_id", "least"), LEAST.items())
def test_experts_never_fail(env_id, least):
    """The goal is reached, and the pole stands, in every episode."""
    assert rollout(expert(env_id), env_id, n_episodes=30, seed=1).returns.min() >= least


def lander_states(dtype):
    rng = np.random.default_rng(0)
    # Wide states for the clipped angle, narrow ones for the thresholds of .05 around zero.
    states = rng.normal(size=(6000, 8)) * np.repeat([1.0, 0.3, 0.05], 2000)[:, None]
    states[:, 6:] = rng.random((6000, 2)) < 0.2
    return states.astype(dtype)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("env_id", ["LunarLander-v3", "LunarLanderContinuous-v3"])
def test_lunar_lander_agrees_with_gymnasium_action_for_action(env_id, dtype):
    states = lander_states(dtype)
    env = SimpleNamespace(unwrapped=SimpleNamespace(continuous="Continuous" in env_id))
    actions = np.clip(expert(env_id).predict(states), *((-1, 1) if "Continuous" in env_id else (0, 3)))
    np.testing.assert_allclose(actions, [heuristic(env, state) for state in states], atol=1e-6)
    if env.unwrapped.continuous:
        assert (np.abs(actions) < 1).any(axis=0).all()
    else:
        assert set(actions) == {0, 1, 2, 3}


def test_mountain_car_follows_the_formula_row_by_row():
    rng = np.random.default_rng(1)
    states = np.column_stack([rng.uniform(-1.2, 0.6, 3000), rng.uniform(-0.07, 0.07, 3000)])
    states[:500, 1] *= 0.02  # near rest, where the first condition decides

    def wanted(p, v):
        lower = min(-0.09 * (p + 0.25) ** 2 + 0.03, 0.3 * (p + 0.9) ** 4 - 0.008)
        upper = -0.07 * (p + 0.38) ** 2 + 0.07
        if p < -0.45 and abs(v) < 0.001:
            return 2
        return 2 if lower < v < upper or (p > 0.2 and v > 0.02) or p > 0.45 else 0

    np.testing.assert_array_equal(expert("MountainCar-v0").predict(states), [wanted(*state) for state in states])


def test_acrobot_follows_the_formula_row_by_row():
    rng = np.random.default_rng(2)
    first, second = rng.uniform(-np.pi, np.pi, (2, 3000))
    v0, v1 = rng.normal(size=(2, 3000))
    states = np.column_stack([np.cos(first), np.sin(first), np.cos(second), np.sin(second), v0, v1])

    def wanted(x0, y0, x1, y1, v0, v1):
        if v1 < -0.3:
            return 0
        if v1 > 0.3:
            return 2
        return 0 if y1 + x0 * y1 + x1 * y0 > 0 else 2

    np.testing.assert_array_equal(expert("Acrobot-v1").predict(states), [wanted(*state) for state in states])


def test_continuous_pendulum_pumps_below_and_holds_above():
    states = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), SPEEDS])
    actions = np.clip(expert("Pendulum-v1").predict(states)[:, 0], -2, 2)
    np.testing.assert_allclose(actions[:2], [-2, 2], rtol=1e-6)  # hanging: with the swing
    assert actions[2] < 0 < actions[3]  # upright: against the fall
    height = (1 + states[:, 0]) / 2
    pump, catch = 2 * SPEEDS + 4 * states[:, 1], -3 * SPEEDS - 12 * states[:, 1]
    np.testing.assert_allclose(actions, np.clip((1 - height) * pump + height * catch, -2, 2), atol=1e-6)


def test_continuous_pendulum_swings_up_and_stays():
    episodes = record(expert("Pendulum-v1"), "Pendulum-v1", n_episodes=30, seed=3)
    assert min(episode.observations[-1, 0] for episode in episodes) > 0.99


def test_continuous_mountain_car_pushes_along_the_motion():
    states = np.column_stack([np.linspace(-1.2, 0.6, 101), np.linspace(-0.07, 0.07, 101)])
    actions = expert("MountainCarContinuous-v0").predict(states)[:, 0]
    np.testing.assert_array_equal(np.sign(actions), np.sign(states[:, 1]))
    assert (np.diff(actions) > 0).all()


def test_unknown_environment_lists_the_known():
    with pytest.raises(DataError, match=r"'Pendulum-v0'.*MountainCar-v0, Acrobot-v1, LunarLander-v3, .*\.$"):
        expert("Pendulum-v0")
