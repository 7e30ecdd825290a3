"""Experts of the benchmarks alone: their returns, and formulas; `simulate` is tested in tests/simulation."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from gymnasium.envs.box2d.lunar_lander import heuristic

import more_experts  # noqa: F401 (makes these known)
from rpil.simulation.rollouts import rollout
from rpil.simulation.simulate import expert

LEAST = {"CartPole-v1": 500, "Pendulum-v1": -600, "MountainCarContinuous-v0": 90, "LunarLanderContinuous-v3": 200}


@pytest.mark.parametrize(("env_id", "least"), LEAST.items())
def test_experts_never_fail(env_id, least):
    assert rollout(expert(env_id), env_id, n_episodes=30, seed=1).returns.min() >= least


def test_lunar_lander_agrees_with_gymnasium_action_for_action():
    states = np.random.default_rng(0).normal(size=(3000, 8)) * np.repeat([1.0, 0.3, 0.05], 1000)[:, None]
    states[:, 6:] = np.random.default_rng(1).random((3000, 2)) < 0.2
    env = SimpleNamespace(unwrapped=SimpleNamespace(continuous=True))
    actions = np.clip(expert("LunarLanderContinuous-v3").predict(states), -1, 1)
    np.testing.assert_allclose(actions, [heuristic(env, state) for state in states], atol=1e-6)
    assert (np.abs(actions) < 1).any(axis=0).all()
