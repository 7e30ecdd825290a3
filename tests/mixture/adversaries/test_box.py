"""Adversaries with continuous actions: densities over the box, that learn without ever losing."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from problems import continuous_zoo, make_continuous, ridge
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.mixture.adversaries.box import MarginalBox, UniformBox
from rpil.mixture.adversaries.named import ADVERSARIES, adversary
from rpil.mixture.adversaries.protocol import Adversary
from rpil.policies.linear import LinearPolicy, linear_policy

TOY = make_continuous("noisy", 0)
PROBLEM = TOY.problem()


def fresh(problem: FitData = PROBLEM) -> LinearPolicy:
    """A policy that has seen no data."""
    return linear_policy(problem.space, ridge(problem), len(problem.actions))


def fitted(name: str, problem: FitData = PROBLEM, seed: int = 0) -> tuple[Adversary, NDArray]:
    """An adversary that has seen some steps, and the outputs of the policy it was fitted beside."""
    _, outputs = fresh(problem).fit(problem, np.ones(len(problem.actions)))
    weight = np.random.default_rng(seed).random(len(problem.actions))
    found = adversary(name, problem.space, fresh(problem))
    for _ in range(3):
        found = found.fit(problem, outputs, weight)
    return found, outputs


@pytest.mark.parametrize("name", ["uniform", "marginal"])
@pytest.mark.parametrize("n_parts", [1, 2])
def test_the_density_integrates_to_one_over_the_box(name, n_parts):
    problem = make_continuous("noisy", 1, n_parts=n_parts).problem()
    found, _ = fitted(name, problem)
    box = problem.space
    edges = [np.linspace(low, high, 101) for low, high in zip(box.low, box.high, strict=True)]
    middles = np.meshgrid(*[(e[1:] + e[:-1]) / 2 for e in edges])
    points = np.stack([m.ravel() for m in middles], axis=1)
    features = np.ones((len(points), problem.features.shape[1]))
    density = np.exp(found.log_prob(features, points, points))
    assert density.sum() * np.exp(box.log_volume) / len(points) == pytest.approx(1.0)  # a bin is five cells wide


def test_log_prob_is_the_definition():
    uniform, outputs = fitted("uniform")
    steps = PROBLEM.features, outputs, PROBLEM.actions
    width = TOY.space.high - TOY.space.low
    np.testing.assert_allclose(uniform.log_prob(*steps), -np.log(width).sum())
    assert UniformBox(TOY.space.log_volume).log_prob(*steps).shape == (len(PROBLEM.actions),)

    found, _ = fitted("marginal")
    bins = np.minimum((20 * (TOY.actions - TOY.space.low) / width).astype(int), 19)
    expected = sum(found.log_density[part, bins[:, part]] for part in range(2))
    np.testing.assert_allclose(found.log_prob(*steps), expected)

    own, _ = fitted("own policy")
    np.testing.assert_array_equal(
        own.log_prob(*steps), own.policy.log_prob(own.policy.outputs(PROBLEM.features), PROBLEM.actions)
    )


@pytest.mark.parametrize("name", ADVERSARIES["continuous"])
def test_fit_never_lowers_the_objective_and_there_is_no_intended_action(name):
    found, outputs = fitted(name)
    assert found.intended_action_proba(outputs, PROBLEM.actions) is None
    for which, toy in continuous_zoo(0).items():
        problem = toy.problem()
        rng = np.random.default_rng(0)
        outputs = rng.normal(size=problem.actions.shape)
        weight = rng.gamma(0.2, size=len(problem.actions)) * (rng.random(len(problem.actions)) < 0.8)

        def objective(found, problem=problem, outputs=outputs, weight=weight):
            return weight @ found.log_prob(problem.features, outputs, problem.actions) + found.log_prior()

        found = adversary(name, problem.space, fresh(problem))
        before = objective(found)
        for _ in range(6):
            found = found.fit(problem, outputs, weight)
            after = objective(found)
            assert after >= before - 1e-9 * abs(before), which
            before = after
        assert np.isfinite(before), which


def test_the_marginal_is_the_mode_under_its_prior_of_a_step_in_each_bin():
    box = Box(np.array([0.0]), np.array([20.0]))
    actions, weight = np.array([[0.5], [0.7], [19.9]]), np.array([1.0, 0.5, 2.0])
    problem = FitData.from_steps(np.ones((3, 1)), actions, box)
    start = MarginalBox.start(box)
    np.testing.assert_allclose(start.log_prob(problem.features, actions, actions), -np.log(20))
    found = start.fit(problem, actions, weight)
    counts = np.ones(20)
    counts[[0, 19]] += 1.5, 2.0
    np.testing.assert_allclose(np.exp(found.log_density[0]), counts / 23.5)  # every bin is 1 wide
    assert found.log_prior() == pytest.approx(np.log(counts / 23.5).sum())
