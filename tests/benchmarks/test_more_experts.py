"""Experts of the benchmarks alone: their returns, and formulas; `simulate` is tested in tests/simulation."""

from __future__ import annotations

import pytest

import more_experts  # noqa: F401 (makes these known)
from rpil.simulation.experts import expert
from rpil.simulation.rollouts import rollout

LEAST = {"CartPole-v1": 500, "Pendulum-v1": -600, "MountainCarContinuous-v0": 90, "LunarLanderContinuous-v3": 200}


@pytest.mark.parametrize(("env_id", "least"), LEAST.items())
def test_experts_never_fail(env_id, least):
    assert rollout(expert(env_id), env_id, n_episodes=30, seed=1).returns.min() >= least
