"""Softmax regression by Newton's method: the optimum, the descent, and the steps from a history of gradients."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import log_softmax, softmax

from rpil.numerics import newton
from rpil.numerics.blocks import gradient, hessian_product
from rpil.numerics.newton import NewtonSettings, Preconditioner, fit_softmax, lbfgs_step

Array = NDArray[np.float64]


def until(tol=1e-6, max_iter=100, max_cg=200):
    return NewtonSettings(tol, max_iter, max_cg)


def soft_problem(seed: int, n: int = 300, n_features: int = 4, n_actions: int = 3) -> tuple[Array, Array, Array]:
    """Design matrix, soft targets of unequal weight, penalty."""
    rng = np.random.default_rng(seed)
    features = np.column_stack([rng.normal(size=(n, n_features)), np.ones(n)])
    targets = rng.dirichlet(np.ones(n_actions), size=n) * rng.gamma(1.0, size=(n, 1))
    return features, targets, np.append(np.full(n_features, 0.7), 0.0)


def objective(weights, features, targets, penalty):
    """The definition, by SciPy's log_softmax."""
    return -(targets * log_softmax(features @ weights, axis=1)).sum() + 0.5 * (penalty[:, None] * weights**2).sum()


def slope(weights, features, targets, penalty):
    residual = targets.sum(axis=1, keepdims=True) * softmax(features @ weights, axis=1) - targets
    return gradient(features, residual) + penalty[:, None] * weights


def test_fit_softmax_survives_nearly_equal_columns():
    rng = np.random.default_rng(0)
    features, targets, penalty = soft_problem(3)
    features[:, 1] = features[:, 0] + 1e-6 * rng.normal(size=len(features))
    penalty[:-1] = 1e-6
    fit = fit_softmax(features, targets, penalty, until(tol=1e-10))
    # Newton's step from there would gain nothing.
    again = fit_softmax(features, targets, penalty, until(tol=0.0, max_iter=5, max_cg=1000), start=fit.weights)
    assert fit.objective - again.objective <= 1e-6


def test_fit_softmax_ends_where_the_gradient_is_zero_and_returns_what_is_true_of_the_weights():
    features, targets, penalty = soft_problem(0)
    fit = fit_softmax(features, targets, penalty, until(max_iter=2))
    assert fit.objective == pytest.approx(objective(fit.weights, features, targets, penalty), rel=1e-12)
    np.testing.assert_allclose(fit.log_proba, log_softmax(features @ fit.weights, axis=1), atol=1e-12)
    fit = fit_softmax(features, targets, penalty, until(tol=1e-10))
    assert np.abs(slope(fit.weights, features, targets, penalty)).max() <= 1e-9 * targets.sum()


@pytest.mark.parametrize("n_features", [4, 60])
def test_fit_softmax_takes_few_passes(n_features, monkeypatch):
    """One for each gradient, and two or three for each step of Newton's method."""
    passes = []

    def counted(function):
        return lambda *arrays: passes.append(function.__name__) or function(*arrays)

    for function in (gradient, hessian_product, newton._inverses):
        monkeypatch.setattr(newton, function.__name__, counted(function))
    problem = soft_problem(0, n=1000, n_features=n_features)
    fit_softmax(*problem, until(tol=1e-10))
    assert passes.count("gradient") <= 6
    assert passes.count("hessian_product") <= 15
    monkeypatch.setattr(newton, "PRECONDITIONER_PRODUCTS", 1)  # after so many another preconditioner is made
    fit_softmax(*problem, until(tol=1e-10))
    assert passes.count("_inverses") > 2
    passes.clear()
    fit_softmax(*problem, until(tol=0.0, max_iter=1, max_cg=1))
    assert passes.count("hessian_product") == 1


def test_a_step_for_a_loose_fit_leaves_a_quarter_of_the_slope():
    features, targets, penalty = soft_problem(0)
    proba, weight = np.full(targets.shape, 1 / 3), targets.sum(axis=1)
    before = slope(np.zeros((5, 3)), features, targets, penalty)
    precondition = Preconditioner(features, proba, weight, penalty + 1e3 * features.std(axis=0))
    step, _ = newton._newton_direction(features, proba, weight, penalty[:, None], before, precondition, until(tol=1e-3))
    rest = before + hessian_product(features, proba, weight, step) + penalty[:, None] * step
    assert 0 < (rest * precondition(rest)).sum() <= 0.25**2 * (before * precondition(before)).sum()


def test_fit_softmax_is_never_above_the_start():
    rng = np.random.default_rng(0)
    for seed in range(20):
        features, targets, penalty = soft_problem(seed, n=40)
        start = rng.normal(size=(5, 3)) * 10 ** rng.uniform(-2, 3)
        before = objective(start, features, targets, penalty)
        previous = before
        for max_iter in (0, 1, 2, 5):
            fit = fit_softmax(features, targets, penalty, until(max_iter=max_iter, max_cg=3), start=start)
            assert fit.objective <= previous + 1e-9 * abs(before)
            previous = fit.objective


def test_fit_softmax_of_separable_classes_is_finite():
    x = np.linspace(-1, 1, 50)
    features = np.column_stack([x, np.ones(50)])
    fit = fit_softmax(features, np.eye(2)[(x > 0).astype(int)], np.array([1e-6, 0.0]), until())
    assert np.isfinite(fit.weights).all()
    assert (fit.log_proba.argmax(axis=1) == (x > 0)).all()


def test_fit_softmax_with_an_action_never_taken_and_steps_of_weight_zero():
    features, targets, penalty = soft_problem(0)
    targets[:, 2] = 0.0
    targets[:100] = 0.0
    fit = fit_softmax(features, targets, penalty, until())
    rest = fit_softmax(features[100:], targets[100:], penalty, until())
    assert np.isfinite(fit.weights).all()
    assert fit.objective == pytest.approx(rest.objective, rel=1e-6)
    assert np.exp(fit.log_proba[:, 2]).max() < 1e-3
    never = Preconditioner(features, np.tile([0.4, 0.6, 0.0], (300, 1)), targets.sum(axis=1), np.zeros(5))
    assert (never(fit.weights) * fit.weights).sum() > 0  # its Hessian is positive


def test_lbfgs_steps_reach_the_optimum():
    features, targets, penalty = soft_problem(5)
    problem = features, targets, penalty
    best = minimize(lambda w: objective(w.reshape(5, 3), *problem), np.zeros(15), tol=1e-12).fun
    proba, weight = np.full(targets.shape, 1 / 3), targets.sum(axis=1)
    precondition = Preconditioner(features, proba, weight, penalty, unseen_curvature=0.25)
    weights, history = np.zeros((5, 3)), np.empty((0, 2, 5, 3))
    for _ in range(12):
        history = np.array([*history, (weights, -slope(weights, *problem))])
        weights = weights + lbfgs_step(history, precondition)
    assert objective(weights, *problem) == pytest.approx(best, rel=1e-8)


def test_a_sample_preconditioner_inverts_the_whole_hessian_and_a_radius_bounds_every_entry_of_the_step():
    features, targets, penalty = soft_problem(6)
    penalty = penalty + 0.1
    proba, weight = softmax(features[:, :3], axis=1), targets.sum(axis=1)
    precondition = Preconditioner(features, proba, weight, penalty, unseen_curvature=1.0)
    direction = np.random.default_rng(0).normal(size=(5, 3))
    direction -= direction.mean(axis=1, keepdims=True)  # which no step changes
    product = hessian_product(features, proba, weight, direction) + penalty[:, None] * direction
    np.testing.assert_allclose(precondition(product), direction, atol=1e-5)
    assert precondition.hessian is not None
    residual = 1e4 * np.random.default_rng(0).normal(size=(5, 3))
    for scale, radius in ((1.0, 0.5), (1.0, 0.01), (1e-4, 10.0)):  # the last is large enough at once
        damping, flat = 1 / radius, scale * residual.T.reshape(-1)
        while np.abs(step := np.linalg.solve(precondition.hessian[0] + damping * np.eye(15), flat)).max() > radius:
            damping *= 4
        np.testing.assert_allclose(precondition(scale * residual, radius=radius).T.reshape(-1), step, rtol=1e-6)
    few = features[:, 3:], proba, weight, penalty[3:]
    blocks = [(few[0].T * (weight * p * (1 - p))) @ few[0] + np.diag(penalty[3:]) for p in proba.T]
    found = Preconditioner(*few, unseen_curvature=1.0).hessian
    np.testing.assert_allclose(found, 1.5 * np.array(blocks), rtol=1e-6)
