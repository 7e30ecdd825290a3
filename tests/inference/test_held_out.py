"""Held-out log-probabilities against scikit-learn."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression, Ridge

from problems import make, make_continuous
from rpil.inference.held_out import HeldOutRidge, HeldOutSoftmax, frequencies, held_out_model, log_reference
from rpil.inference.parts import ActionScale
from rpil.inference.settings import HeldOutSettings
from rpil.numerics.regression import ErrorSettings, error_scale, mean_ranks, student_log_densities
from rpil.policies.folds import deal

STEPS = (40, 60)
LAPSE = HeldOutSettings().lapse


def test_softmax_log_probabilities_are_those_of_scikit_learn_on_the_other_folds():
    problem = make("noisy", 0, steps=STEPS).problem()
    weight = np.random.default_rng(0).random(len(problem.actions))
    found = HeldOutSoftmax(problem, deal(problem, 3, 0), HeldOutSettings())
    scored = found.evaluate(weight, 1e-2)
    fold, q = problem.per_step(found.fold), frequencies(problem)
    for k in range(3):
        train, test = fold != k, fold == k
        C = 1 / (1e-2 * weight[train].sum())
        model = LogisticRegression(C=C, tol=1e-8, max_iter=5000)
        model.fit(problem.features[train][:, :-1], problem.actions[train], sample_weight=weight[train])
        proba = (1 - LAPSE) * model.predict_proba(problem.features[test][:, :-1]) + LAPSE * q
        taken = np.log(proba[np.arange(test.sum()), problem.actions[test]])
        np.testing.assert_allclose(scored[test], taken, atol=0.03)


@pytest.mark.parametrize("kind", ["noisy", "flipped", "random"])
def test_fits_that_go_on_from_others_rank_demonstrations_as_fits_to_the_end(kind):
    """After other ridges and other groups, with a Hessian that all folds share."""
    problem = make(kind, 1, n_good=20, n_bad=10, steps=STEPS).problem()
    rng, group = np.random.default_rng(0), problem.per_step(np.arange(30) < 18).astype(float)
    model = held_out_model(problem, HeldOutSettings())
    for ridge in HeldOutSettings().ridges[:2]:
        model.evaluate(rng.random(len(problem.actions)), ridge)
    exact = held_out_model(problem, replace(HeldOutSettings(), tol=1e-9))
    scores = [problem.mean_steps(each.evaluate(group, 1e-3)) for each in (model, exact)]
    assert np.corrcoef(*map(mean_ranks, scores))[0, 1] >= 0.999


@pytest.mark.parametrize("maker", [make, make_continuous])
def test_what_was_asked_before_is_not_fitted_again(maker):
    problem = maker("noisy", 0, steps=STEPS).problem()
    model, group = held_out_model(problem, HeldOutSettings()), np.ones(len(problem.actions))
    first = model.evaluate(group, 1e-2)
    assert model.evaluate(1e-2 * group, 1e-2) is not first
    assert model.evaluate(group.copy(), 1e-2) is first


def test_ridge_log_probabilities_are_those_of_scikit_learn_on_the_other_folds():
    problem = make_continuous("noisy", 0, steps=STEPS).problem()
    weight = np.random.default_rng(0).random(len(problem.actions))
    found = HeldOutRidge(problem, deal(problem, 3, 0), HeldOutSettings())
    scored = found.evaluate(weight, 1e-2)
    fold, actions = problem.per_step(found.fold), ActionScale.of(problem)(problem.actions)
    errors = np.empty_like(actions)
    for k in range(3):
        train, test = fold != k, fold == k
        model = Ridge(1e-2 * weight[train].sum())
        model.fit(problem.features[train][:, :-1], actions[train], sample_weight=weight[train])
        errors[test] = actions[test] - model.predict(problem.features[test][:, :-1]).reshape(-1, actions.shape[1])
    scale = error_scale(errors, weight, ErrorSettings())
    np.testing.assert_allclose(scored, student_log_densities(errors, scale, ErrorSettings()).sum(axis=1), atol=1e-6)


@pytest.mark.parametrize("maker", [make, make_continuous])
def test_folds_follow_from_the_demonstrations_and_few_are_folds_of_their_own(maker):
    problem = maker("noisy", 0, steps=STEPS).problem()
    model = held_out_model(problem, HeldOutSettings(max_left_out=12))
    assert isinstance(model, HeldOutSoftmax if maker is make else HeldOutRidge)
    assert sorted(model.fold) == list(range(12))
    for max_folds, n_folds in ((5, 5), (20, 12)):
        many = HeldOutSettings(max_left_out=11, max_folds=max_folds)
        found = held_out_model(problem, many).fold
        np.testing.assert_array_equal(found, deal(problem, n_folds, 0))
        assert len(set(found)) == n_folds


def test_the_best_reference_is_by_mean_and_deviation_where_these_explain_more():
    """Of two values the median is one."""
    problem = make_continuous("noisy", 0, steps=STEPS, n_parts=1).problem()
    everyone, settings = np.ones(12, dtype=bool), HeldOutSettings()
    two = replace(problem, actions=np.where(problem.actions > np.quantile(problem.actions, 0.4), 1.0, -1.0))
    for data, is_better in ((problem, False), (two, True)):
        plain, best = (log_reference(data, everyone, settings, best) for best in (False, True))
        assert (best.mean() > plain.mean()) == is_better
        actions = ActionScale.of(data)(data.actions)
        by_mean = student_log_densities(actions - actions.mean(), actions.std(axis=0) + 0.03, settings.errors)[:, 0]
        np.testing.assert_allclose(best, by_mean if is_better else plain)
