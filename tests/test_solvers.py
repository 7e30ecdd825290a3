"""The solver finds the optimum that scikit-learn finds, and its passes are the sums they claim to be."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import approx_fprime
from scipy.special import log_softmax, softmax
from sklearn.linear_model import LogisticRegression
from sklearn.preprocessing import SplineTransformer

from problems import make
from rpil.estimators.cloning import BehavioralCloning
from rpil.numerics import blocks as passes
from rpil.numerics.newton import NewtonSettings, fit_softmax


def soft_problem(
    seed: int, n: int = 300, n_features: int = 4, n_actions: int = 3
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Design matrix, soft targets of unequal weight, penalty."""
    rng = np.random.default_rng(seed)
    features = np.column_stack([rng.normal(size=(n, n_features)), np.ones(n)])
    targets = rng.dirichlet(np.ones(n_actions), size=n) * rng.gamma(1.0, size=(n, 1))
    return features, targets, np.append(np.full(n_features, 0.7), 0.0)


def objective(weights, features, targets, penalty):
    """The definition, in SciPy's words."""
    return -(targets * log_softmax(features @ weights, axis=1)).sum() + 0.5 * (penalty[:, None] * weights**2).sum()


def regression_objective(coef, intercept, columns, actions, sample_weight, C):
    """What scikit-learn's LogisticRegression minimises, divided by C."""
    scores = columns @ coef.T + intercept
    if len(coef) == 1:
        scores = np.column_stack([np.zeros(len(scores)), scores])
    loss = -(sample_weight * log_softmax(scores, axis=1)[np.arange(len(actions)), actions]).sum()
    return loss + 0.5 / C * (coef**2).sum()


@pytest.mark.parametrize("n_actions", [2, 3, 5])
@pytest.mark.parametrize("features", ["raw", "spline"])
@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("C", [0.1, 100.0])
def test_agrees_with_scikit_learn(n_actions, features, weighted, C):
    toy = make("random", 1, n_actions=n_actions, n_observations=3)
    X = toy.observations * [1.0, 30.0, 0.2] + [0.0, 50.0, -3.0]
    weight = np.random.default_rng(2).gamma(2.0, size=len(X)) if weighted else np.ones(len(X))
    ours = BehavioralCloning(features=features, C=C).fit(X, toy.actions, sample_weight=weight)
    columns = X
    if features == "spline":
        knots = np.linspace(X.min(axis=0), X.max(axis=0), 8)
        columns = SplineTransformer(degree=3, knots=knots, extrapolation="linear").fit_transform(X)
    theirs = LogisticRegression(C=C, solver="newton-cholesky", tol=1e-12, max_iter=1000)
    theirs.fit(columns, toy.actions, sample_weight=weight)
    found, best = (
        regression_objective(model.coef_, model.intercept_, columns, toy.actions, weight, C) for model in (ours, theirs)
    )
    assert abs(found - best) <= 1e-6 * max(1.0, best)
    np.testing.assert_allclose(ours.coef_, theirs.coef_, atol=1e-4 * np.abs(theirs.coef_).max())
    np.testing.assert_allclose(ours.predict_proba(X), theirs.predict_proba(columns), atol=1e-5)


@pytest.mark.parametrize("units", [[1e-6, 1.0, 1e6], [1e-15, 1.0, 1e15]])
@pytest.mark.parametrize("features", ["raw", "spline", "poly"])
def test_units_do_not_matter(units, features):
    toy = make("random", 3, n_observations=3)
    X, Z = toy.observations, toy.observations * units
    plain, scaled = (BehavioralCloning(features).fit(x, toy.actions) for x in (X, Z))
    np.testing.assert_allclose(scaled.predict_log_proba(Z), plain.predict_log_proba(X), rtol=1e-4, atol=1e-6)


def test_columns_that_are_nearly_the_same():
    rng = np.random.default_rng(0)
    features, targets, penalty = soft_problem(3)
    features[:, 1] = features[:, 0] + 1e-6 * rng.normal(size=len(features))
    penalty[:-1] = 1e-6
    fit = fit_softmax(features, targets, penalty, NewtonSettings(tol=1e-10))
    assert fit.converged
    # Newton's step from there would gain nothing.
    again = fit_softmax(features, targets, penalty, NewtonSettings(tol=0.0, max_iter=5, max_cg=1000), start=fit.weights)
    assert fit.objective - again.objective <= 1e-6


def test_objective_is_its_definition_and_log_proba_belongs_to_the_weights():
    features, targets, penalty = soft_problem(0)
    fit = fit_softmax(features, targets, penalty, NewtonSettings(max_iter=2))
    assert fit.objective == pytest.approx(objective(fit.weights, features, targets, penalty), rel=1e-12)
    np.testing.assert_allclose(fit.log_proba, log_softmax(features @ fit.weights, axis=1), atol=1e-12)


def test_gradient_and_hessian_product_agree_with_finite_differences():
    features, targets, penalty = soft_problem(1)
    rng = np.random.default_rng(0)
    weights, direction = rng.normal(size=(2, 5, 3))
    ridge, weight = penalty[:, None], targets.sum(axis=1)

    def slope(at):
        residual = weight[:, None] * softmax(features @ at, axis=1) - targets
        return passes.gradient(features, residual) + ridge * at

    numeric = approx_fprime(weights.ravel(), lambda w: objective(w.reshape(5, 3), features, targets, penalty), 1e-6)
    np.testing.assert_allclose(slope(weights).ravel(), numeric, rtol=1e-4, atol=1e-3)
    proba = softmax(features @ weights, axis=1)
    product = passes.hessian_product(features, proba, weight, direction) + ridge * direction
    h = 1e-5
    numeric = (slope(weights + h * direction) - slope(weights - h * direction)) / (2 * h)
    np.testing.assert_allclose(product, numeric, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_gradient_is_zero_at_the_optimum_of_soft_targets(seed):
    features, targets, penalty = soft_problem(seed)
    fit = fit_softmax(features, targets, penalty, NewtonSettings(tol=1e-10))
    proba = softmax(features @ fit.weights, axis=1)
    slope = features.T @ (targets.sum(axis=1, keepdims=True) * proba - targets) + penalty[:, None] * fit.weights
    assert fit.converged
    assert np.abs(slope).max() <= 1e-9 * targets.sum()


def test_never_above_the_start():
    rng = np.random.default_rng(0)
    for seed in range(20):
        features, targets, penalty = soft_problem(seed, n=40)
        start = rng.normal(size=(5, 3)) * 10 ** rng.uniform(-2, 3)
        before = objective(start, features, targets, penalty)
        previous = before
        for max_iter in (0, 1, 2, 5):
            fit = fit_softmax(features, targets, penalty, NewtonSettings(max_iter=max_iter, max_cg=3), start=start)
            assert fit.objective <= previous + 1e-9 * abs(before)
            previous = fit.objective


def test_start_is_left_alone():
    features, targets, penalty = soft_problem(0)
    start = np.ones((5, 3))
    fit_softmax(features, targets, penalty, start=start)
    np.testing.assert_array_equal(start, 1.0)


def test_separable_classes_stay_finite():
    x = np.linspace(-1, 1, 50)
    features = np.column_stack([x, np.ones(50)])
    fit = fit_softmax(features, np.eye(2)[(x > 0).astype(int)], np.array([1e-6, 0.0]))
    assert fit.converged
    assert np.isfinite(fit.weights).all()
    assert (fit.log_proba.argmax(axis=1) == (x > 0)).all()


def test_an_action_that_nobody_takes_and_steps_that_do_not_count():
    features, targets, penalty = soft_problem(0)
    targets[:, 2] = 0.0
    targets[:100] = 0.0
    fit = fit_softmax(features, targets, penalty)
    rest = fit_softmax(features[100:], targets[100:], penalty)
    assert np.isfinite(fit.weights).all()
    assert fit.objective == pytest.approx(rest.objective, rel=1e-6)
    assert np.exp(fit.log_proba[:, 2]).max() < 1e-3


@pytest.mark.parametrize("n", [1, 63, 64, 65, 1000])
def test_blocked_passes_equal_whole_ones(n, monkeypatch):
    rng = np.random.default_rng(n)
    features, weights = rng.normal(size=(n, 7)), rng.normal(size=(7, 3))
    proba, weight, direction = rng.dirichlet(np.ones(3), n), rng.random(n), rng.normal(size=(7, 3))

    def all_passes():
        return (
            passes.linear(features, weights),
            passes.gradient(features, proba),
            passes.hessian_product(features, proba, weight, direction),
        )

    whole = all_passes()
    monkeypatch.setattr(passes, "BLOCK_BYTES", 1)  # down to the least number of rows
    assert len(list(passes.blocks(features))) == -(-n // 64)
    z = features @ direction
    jacobian = weight[:, None] * proba * (z - (proba * z).sum(axis=1, keepdims=True))
    expected = features @ weights, features.T @ proba, features.T @ jacobian
    for ours, blocked, plain in zip(whole, all_passes(), expected, strict=True):
        np.testing.assert_allclose(blocked, ours, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(ours, plain, rtol=1e-12, atol=1e-13)


def test_blocks_cover_every_row_once():
    features = np.zeros((100_003, 9))
    rows = np.concatenate([np.arange(b.start, b.stop) for b in passes.blocks(features)])
    np.testing.assert_array_equal(rows, np.arange(len(features)))


def test_float32_features():
    features, targets, penalty = soft_problem(4, n=2000)
    double = fit_softmax(features, targets, penalty)
    single = fit_softmax(features.astype(np.float32), targets, penalty, NewtonSettings(tol=1e-5))
    assert single.converged
    assert single.objective == pytest.approx(double.objective, rel=1e-5)
    np.testing.assert_allclose(single.weights, double.weights, atol=1e-3)


def test_log_softmax_neither_overflows_nor_underflows():
    logits = np.array([[1e4, 0.0, -1e4], [-1e4, -1e4, -1e4]])
    np.testing.assert_allclose(passes.log_softmax(logits), [[0, -1e4, -2e4], [-np.log(3)] * 3])


def test_twice_the_data_is_the_same_default_policy():
    toy = make("random", 0)
    once = BehavioralCloning().fit(toy.observations, toy.actions)
    twice = BehavioralCloning().fit(np.repeat(toy.observations, 2, axis=0), np.repeat(toy.actions, 2))
    np.testing.assert_allclose(
        once.predict_log_proba(toy.observations), twice.predict_log_proba(toy.observations), rtol=1e-4, atol=1e-6
    )
