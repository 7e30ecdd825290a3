"""The closed-form experts: their formulas."""

from types import SimpleNamespace

import numpy as np
import pytest
from gymnasium.envs.box2d.lunar_lander import heuristic

from rpil.simulation.simulate import expert


def lander_states(dtype):
    rng = np.random.default_rng(0)
    # Wide states for the clipped angle, narrow ones for the thresholds of .05 around zero.
    states = rng.normal(size=(6000, 8)) * np.repeat([1.0, 0.3, 0.05], 2000)[:, None]
    states[:, 6:] = rng.random((6000, 2)) < 0.2
    return states.astype(dtype)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_lunar_lander_agrees_with_gymnasium_action_for_action(dtype):
    states = lander_states(dtype)
    env = SimpleNamespace(unwrapped=SimpleNamespace(continuous=False))
    actions = expert("LunarLander-v3").predict(states)
    np.testing.assert_array_equal(actions, [heuristic(env, state) for state in states])
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
