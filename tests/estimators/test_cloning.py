"""Behavioural cloning is scikit-learn's logistic regression, whatever the amount of data, of the features chosen."""

import numpy as np
import pytest
from scipy.special import log_softmax
from sklearn.linear_model import LogisticRegression

from problems import coefficients, curved, make, told
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.estimators.cloning import BehavioralCloning, LinearPolicySpec
from rpil.policies.features import FeatureSettings
from rpil.policies.selection import FeatureChoice, choose_features
from rpil.policies.settings import SelectionSettings


def regression_objective(coef, intercept, columns, actions, sample_weight, C):
    """What scikit-learn's LogisticRegression minimises, divided by C."""
    scores = columns @ coef.T + intercept
    if len(coef) == 1:
        scores = np.column_stack([np.zeros(len(scores)), scores])
    loss = -(sample_weight * log_softmax(scores, axis=1)[np.arange(len(actions)), actions]).sum()
    return loss + 0.5 / C * (coef**2).sum()


@pytest.mark.parametrize("n_actions", [2, 3])
@pytest.mark.parametrize("features", ["raw", "folded"])
@pytest.mark.parametrize(("C", "options", "weighted"), [(0.01, {}, True), (1e4, {"tol": 1e-12}, False)])
def test_cloning_agrees_with_scikit_learn(n_actions, features, C, options, weighted):
    toy = make("random", 1, n_actions=n_actions, n_observations=3)
    X = toy.observations * [1.0, 30.0, 0.2] + [0.0, 50.0, -3.0]
    weight = np.random.default_rng(2).gamma(2.0, size=len(X)) if weighted else np.ones(len(X))
    ours = BehavioralCloning(features, C=C, **options).fit(X, toy.actions, sample_weight=weight)
    distance = np.abs(X - np.average(X, axis=0, weights=weight)) / ours.features_.spread
    columns = X if features == "raw" else np.hstack([X, distance])
    theirs = LogisticRegression(C=C, solver="newton-cholesky", tol=1e-12, max_iter=1000)
    theirs.fit(columns, toy.actions, sample_weight=weight)
    coef, intercept = coefficients(ours)
    found, best = (
        regression_objective(*each, columns, toy.actions, weight, C)
        for each in ((coef, intercept), (theirs.coef_, theirs.intercept_))
    )
    assert abs(found - best) <= 1e-6 * max(1.0, best)
    assert intercept.shape == theirs.intercept_.shape
    np.testing.assert_allclose(coef, theirs.coef_, atol=1e-4 * np.abs(theirs.coef_).max())
    np.testing.assert_allclose(ours.predict_proba(X), theirs.predict_proba(columns), atol=1e-5)


def test_cloning_takes_what_is_chosen():
    observations, codes, offsets = told(curved)
    data = Demonstrations(observations, codes, offsets)
    steps = FitData(observations, codes, offsets, Discrete(2))
    chosen = choose_features(steps, np.ones(len(codes)), None, SelectionSettings())
    model = BehavioralCloning("auto").fit(data)
    assert (model.features_.kind, model.features_.ridge_per_step) == (chosen.kind, chosen.ridge)
    fixed = BehavioralCloning("nystroem").fit(data)
    assert fixed.features_.ridge_per_step == FeatureSettings.ridge_per_step
    assert np.mean(model.predict(observations) == codes) > 0.97
    rows = BehavioralCloning("auto").fit(observations, codes)  # every row is held out on its own
    assert rows.features_.kind == "nystroem"


@pytest.mark.parametrize(("largest", "least"), [(0.2, 0.1), (1.0, 0.5), (4.0, 0.5)])
def test_a_feature_map_is_fitted_to_the_steps_that_are_trusted(largest, least):
    X, weight = np.random.default_rng(0).normal(size=(40, 2)), np.linspace(0, largest, 40)
    spec = LinearPolicySpec("raw", None, 1e-8, SelectionSettings(), min_feature_weight=0.5)
    found = spec.feature_map(FeatureChoice("raw", 1e-5), X, weight)
    trusted = weight > least
    np.testing.assert_allclose(found.center, np.average(X[trusted], axis=0, weights=weight[trusted]))
