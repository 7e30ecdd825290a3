"""Held-out log-probabilities against scikit-learn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression, Ridge

from problems import fit_data_of, make, make_continuous
from rpil.inference.held_out import HeldOutRidge, HeldOutSoftmax, frequencies, held_out_model, log_reference
from rpil.inference.parts import ActionScale
from rpil.inference.settings import HeldOutSettings
from rpil.numerics.regression import ErrorSettings, error_scale, student_log_densities
from rpil.policies.folds import deal

STEPS = (40, 60)
LAPSE = HeldOutSettings().lapse


def test_softmax_log_probabilities_are_those_of_scikit_learn_on_the_other_folds():
    problem = fit_data_of(make("noisy", 0, steps=STEPS))
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


def test_ridge_log_probabilities_are_those_of_scikit_learn_on_the_other_folds():
    problem = fit_data_of(make_continuous("noisy", 0, steps=STEPS))
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


def test_reference_does_not_depend_on_the_state():
    problem = fit_data_of(make("random", 0))
    everyone = np.ones(problem.n_demonstrations, dtype=bool)
    shuffled = replace(problem, features=problem.features[::-1])
    log_q = log_reference(problem, everyone, HeldOutSettings())
    np.testing.assert_array_equal(log_q, log_reference(shuffled, everyone, HeldOutSettings()))
    for action in range(problem.space.n):
        share = (problem.actions == action).mean()
        assert np.exp(log_q[problem.actions == action]).mean() == pytest.approx(share, abs=0.01)


def test_parts_of_the_action_sum_to_the_whole():
    problem = fit_data_of(make_continuous("noisy", 0, steps=STEPS, n_parts=3))
    weight = np.random.default_rng(0).random(len(problem.actions))
    found = HeldOutRidge(problem, deal(problem, 3, 0), HeldOutSettings())
    parts = found.log_prob_of_parts(weight, 1e-2)
    assert parts.shape == (len(problem.actions), 3)
    np.testing.assert_allclose(parts.sum(axis=1), found.evaluate(weight, 1e-2))
    softmax = fit_data_of(make("noisy", 0, steps=STEPS))
    assert HeldOutSoftmax(softmax, deal(softmax, 3, 0), HeldOutSettings()).log_prob_of_parts(weight, 1e-2) is None


def test_errors_may_have_the_scale_of_other_steps():
    problem = fit_data_of(make_continuous("random", 0, steps=STEPS))
    good = problem.per_step((np.arange(12) < 6).astype(float))
    found = HeldOutRidge(problem, deal(problem, 3, 0), HeldOutSettings())
    own, at_bad = found.evaluate(good, 1e-2), found.log_prob_at(good, 1.0 - good, 1e-2)
    np.testing.assert_array_equal(found.log_prob_at(good, good, 1e-2), own)
    assert own[good > 0].mean() > at_bad[good > 0].mean() + 0.5
    assert own[good == 0].mean() < at_bad[good == 0].mean() - 0.5
    assert found.evaluate(1.0 - good, 1e-2)[good > 0].mean() != at_bad[good > 0].mean()  # another policy
    softmax = fit_data_of(make("random", 0, steps=STEPS))
    good = softmax.per_step((np.arange(12) < 6).astype(float))
    model = HeldOutSoftmax(softmax, deal(softmax, 3, 0), HeldOutSettings())
    expected = model.cold_copy().evaluate(good, 1e-2)
    np.testing.assert_array_equal(model.log_prob_at(good, 1.0 - good, 1e-2), expected)  # no scale


@pytest.mark.parametrize("toy", [make("noisy", 0, steps=STEPS), make_continuous("noisy", 0, steps=STEPS)])
def test_other_folds_and_a_cold_copy(toy):
    problem = fit_data_of(toy)
    found = held_out_model(problem, 0, HeldOutSettings(max_folds=3, max_left_out=0))
    again = found.dealt_again(1)
    assert (again.fold != found.fold).any()
    np.testing.assert_array_equal(again.fold, held_out_model(problem, 1, found.settings).fold)
    weight = np.ones(len(problem.actions))
    first = found.evaluate(weight, 1e-2)
    found.evaluate(weight * (problem.per_step(np.arange(12)) < 3), 1e-1)
    np.testing.assert_array_equal(found.cold_copy().evaluate(weight, 1e-2), first)
    np.testing.assert_array_equal(found.cold_copy().fold, found.fold)
