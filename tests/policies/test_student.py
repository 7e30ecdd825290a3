"""The policy for continuous actions: the density it claims to be, and learning that never loses nor follows a few."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import multivariate_t

from problems import continuous_zoo, make_continuous, ridge
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.policies.linear import linear_policy
from rpil.policies.student import DEGREES_OF_FREEDOM, StudentPolicy, _Fitted

ZOO = continuous_zoo(0)


def some_policy(n_parts: int, freedom: float = 3.0, seed: int = 0) -> StudentPolicy:
    """Parameters at no special place, for two features and the constant."""
    rng = np.random.default_rng(seed)
    scale = rng.normal(size=(n_parts, n_parts))
    cholesky = np.linalg.cholesky(scale @ scale.T + 0.3 * np.eye(n_parts))
    weights, nowhere = rng.normal(size=(3, n_parts)), np.full(n_parts, np.inf)
    return StudentPolicy(
        weights, cholesky, freedom, np.array([0.3, 0.2, 0.0]), np.full(n_parts, 0.1), -nowhere, nowhere
    )


def saturated(n: int, noise: float, seed: int = 0) -> tuple[FitData, NDArray]:
    """A linear controller who asks for more than the box allows in most steps, and what it would ask for."""
    rng = np.random.default_rng(seed)
    features, _ = some_steps(n, 2, seed)
    wanted = features @ np.array([[2.0, 1.0], [-3.0, 0.5], [0.5, -0.3]])
    errors = rng.normal(size=(n, 2)) @ np.array([[noise, 0.8 * noise], [0.0, 0.6 * noise]])
    box = Box(-np.ones(2), np.ones(2))
    return FitData.from_steps(features, box.bounded(wanted + errors), box), wanted


def some_steps(n: int, n_parts: int, seed: int = 1) -> tuple[NDArray, NDArray]:
    """Features and actions."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.normal(size=(n, 2)), np.ones(n)]), 3 * rng.normal(size=(n, n_parts))


BOUNDED = {f"at the bounds, {noise}": saturated(400, noise)[0] for noise in (0.02, 0.3, 2.0)}


def zero(problem: FitData) -> StudentPolicy:
    return linear_policy(problem.space, ridge(problem), len(problem.actions))


def objective(policy: StudentPolicy, problem: FitData, weight: NDArray) -> float:
    return float(weight @ policy.log_prob(policy.outputs(problem.features), problem.actions) - policy.penalty())


@pytest.mark.parametrize(("n_parts", "freedom"), [(1, 5.0), (2, 1.0), (4, 100.0)])
def test_it_is_students_density(n_parts, freedom):
    policy = some_policy(n_parts, freedom)
    features, actions = some_steps(20, n_parts)
    outputs = policy.outputs(features)
    np.testing.assert_allclose(outputs, features @ policy.weights)
    shape = policy.cholesky @ policy.cholesky.T
    both = zip(outputs, actions, strict=True)
    expected = [multivariate_t(mean, shape, df=freedom).logpdf(action) for mean, action in both]
    np.testing.assert_allclose(policy.log_prob(outputs, actions), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("action", "mean", "error"), [(1.0, 3.0, 0.06), (1.0, 0.4, 0.6), (-1.0, -7.0, 0.18), (0.2, 3.0, 2.8)]
)
def test_a_mean_beyond_the_bound_is_nearly_as_good_as_one_on_it(action, mean, error):
    policy = StudentPolicy.zero(Box(np.array([-1.0]), np.array([1.0])), np.zeros(3), 1.0)
    free = replace(policy, low=np.array([-np.inf]), high=np.array([np.inf]))
    found = policy.log_prob(np.array([[mean]]), np.array([[action]]))
    np.testing.assert_allclose(found, free.log_prob(np.array([[0.0]]), np.array([[error]])))


@pytest.mark.parametrize("name", [*ZOO, *BOUNDED])
def test_no_step_of_learning_lowers_the_objective(name):
    problem = BOUNDED[name] if name in BOUNDED else ZOO[name].problem()
    rng = np.random.default_rng(0)
    for weight in (np.ones(len(problem.actions)), rng.gamma(0.3, size=len(problem.actions))):
        policy = zero(problem)
        history = [objective(policy, problem, weight)]
        for _ in range(15):
            policy, outputs = policy.fit(problem, weight, max_iter=1)
            np.testing.assert_allclose(outputs, policy.outputs(problem.features), atol=1e-9 * np.abs(outputs).max())
            history.append(objective(policy, problem, weight))
        assert np.isfinite(history).all()
        assert np.diff(history).min() >= -1e-9 * np.abs(history).max()
        assert history[-1] > history[0]
        assert policy.freedom in DEGREES_OF_FREEDOM


def test_it_finds_a_controller_that_the_box_cuts_short():
    problem, wanted = saturated(2000, 0.02)
    assert (np.abs(problem.actions) == 1.0).mean() > 0.5
    policy, outputs = zero(problem).fit(problem, np.ones(2000), tol=1e-9, max_iter=500)
    within = np.abs(wanted) < 1.0
    nowhere = np.full(2, np.inf)
    _, said = replace(policy, low=-nowhere, high=nowhere).fit(problem, np.ones(2000), tol=1e-9, max_iter=500)
    errors = [np.abs(problem.space.bounded(mean) - problem.actions)[within].mean() for mean in (outputs, said)]
    assert errors[0] < 0.03
    assert errors[1] > 5 * errors[0]


def test_it_ends_where_no_direction_is_better():
    problem = ZOO["noisy"].problem()
    weight = np.random.default_rng(0).random(len(problem.actions))
    policy, _ = zero(problem).fit(problem, weight, tol=0.0, max_iter=2000)
    best, rng = objective(policy, problem, weight), np.random.default_rng(1)
    for _ in range(20):
        weights = policy.weights + 1e-3 * rng.normal(size=policy.weights.shape)
        cholesky = policy.cholesky * (1 + 1e-3 * rng.normal(size=policy.cholesky.shape))
        assert objective(replace(policy, weights=weights, cholesky=cholesky), problem, weight) <= best + 1e-9
    for freedom in DEGREES_OF_FREEDOM:
        assert objective(replace(policy, freedom=float(freedom)), problem, weight) <= best + 1e-9


def test_steps_by_sums_reach_the_fit_within_a_radius_and_those_without_weight_change_nothing():
    problem, history = ZOO["noisy"].problem(), np.empty((0, 2, 0, 0))
    weight = np.random.default_rng(0).random(len(problem.actions))
    policy = start = zero(problem)
    sums = policy.collect_suff_stats(problem.features, problem.actions, 0 * weight)[1]
    assert (policy.gradient_norm(sums), policy.m_step(sums, np.inf, None, history)[0]) == (0.0, policy)
    sums = policy.collect_suff_stats(problem.features, problem.actions, weight)[1]
    assert sums[-1] == 0  # errors beyond a bound, so that parts have the same Hessian
    np.testing.assert_allclose(start._step(*sums[:2], kinked=True), start._step(*sums[:2], kinked=False))
    near, _ = policy.m_step(sums, 1e-2, None, history)
    moved = np.abs(near.weights - policy.weights) / np.sqrt((policy.cholesky**2).sum(axis=1))
    assert moved.max() == pytest.approx(1e-2)
    for _ in range(100):
        last = policy.collect_suff_stats(problem.features, problem.actions, weight)[1]
        policy, _ = policy.m_step(last, np.inf, None, history)
    assert policy.gradient_norm(last) < 1e-3 < start.gradient_norm(sums)
    best, _ = start.fit(problem, weight, tol=0.0, max_iter=2000)
    assert objective(policy, problem, weight) == pytest.approx(objective(best, problem, weight))
    begun = _Fitted.at(start, start.outputs(problem.features), problem.actions, weight)
    step = 3 * (best.weights - start.weights)
    half = start._shortened(step, problem.features @ step, problem.actions, begun, weight)
    assert half.objective > begun.objective


def test_a_tenth_of_gross_outliers_does_not_move_it():
    toy = make_continuous("none", 4, n_parts=3, n_good=20, n_bad=0, steps=(100, 100))
    clean = toy.problem()
    rng = np.random.default_rng(0)
    actions, far = toy.actions.copy(), rng.random(len(toy.actions)) < 0.1
    actions[far] = 20.0 + 50.0 * toy.observations[far, :1]  # all of one mind, too
    spoiled = replace(clean, actions=actions)  # the box is the declared one
    ones = np.ones(len(actions))
    truth = toy.observations @ toy.weights[:-1] + toy.weights[-1]
    policy, outputs = zero(spoiled).fit(spoiled, ones)
    assert np.abs(outputs - truth).mean() < 0.05
    least_squares = clean.features @ np.linalg.lstsq(clean.features, actions)[0]
    assert np.abs(least_squares - truth).mean() > 1.0
    assert policy.freedom <= 3.0


def test_a_part_that_never_moves_is_predicted_and_no_more():
    toy = ZOO["a part that never moves"]
    problem = toy.problem()
    middle = np.quantile(problem.actions, [0, 1], axis=0).mean(axis=0)
    np.testing.assert_allclose(zero(problem).outputs(problem.features[:1]), [middle])
    policy, outputs = zero(problem).fit(problem, np.ones(len(problem.actions)))
    np.testing.assert_allclose(outputs[:, 1], 3.0, atol=1e-6)
    assert np.isfinite(policy.log_prob(outputs, problem.actions)).all()
    # and it is no surer of it than a hundredth of the box allows
    spread = np.sqrt((policy.cholesky @ policy.cholesky.T)[1, 1])
    assert spread == pytest.approx(0.01, rel=0.3)


def test_a_weight_of_two_is_a_step_taken_twice_and_one_of_zero_is_none():
    problem = ZOO["noisy"].problem()
    times = np.where(problem.actions[:, 0] > np.median(problem.actions[:, 0]), 2, 0)
    rows = np.repeat(np.arange(len(times)), times)
    twice = FitData.from_steps(problem.features[rows], problem.actions[rows], problem.space)
    one, _ = zero(problem).fit(problem, times.astype(float))
    two, _ = zero(problem).fit(twice, np.ones(len(rows)))
    np.testing.assert_allclose(one.weights, two.weights, atol=1e-9)
    np.testing.assert_allclose(one.cholesky, two.cholesky, atol=1e-9)


def test_columns_that_are_no_columns_are_survived():
    """Two columns alike and no ridge: least squares without a unique solution."""
    features, actions = some_steps(50, 1)
    features = np.column_stack([features[:, 0], features[:, 0], np.ones(50)])
    problem = FitData.from_steps(features, actions, Box.around(actions))
    policy, outputs = StudentPolicy.zero(problem.space, np.zeros(3), 50).fit(problem, np.ones(50))
    alone = replace(problem, features=features[:, 1:])
    expected, _ = StudentPolicy.zero(problem.space, np.zeros(2), 50).fit(alone, np.ones(50))
    np.testing.assert_allclose(outputs, expected.outputs(features[:, 1:]), atol=1e-4)
    assert np.isfinite(policy.weights).all()


def test_a_fit_of_alike_errors_with_heavy_tails_takes_ten_iterations():
    """Errors of the parts are almost the same, and some actions are at a bound."""
    rng, n = np.random.default_rng(0), 600
    features = np.column_stack([rng.normal(size=(n, 3)), np.ones(n)])
    errors = rng.standard_t(1, size=(n, 1)) + 0.05 * rng.normal(size=(n, 3))
    box = Box(np.full(3, -2.0), np.full(3, 2.0))
    problem = FitData.from_steps(features, box.bounded(features @ rng.normal(size=(4, 3)) + 0.1 * errors), box)
    values = []
    for max_iter in (10, 100):
        policy, _ = zero(problem).fit(problem, np.ones(n), max_iter=max_iter)
        values.append(objective(policy, problem, np.ones(n)) / n)
    assert values[1] - values[0] < 1e-3
