"""Scores, their variances, and whether the state predicts the action."""

from dataclasses import replace

import numpy as np
import pytest

from hand_made import Written, reference, same_actions
from problems import make_continuous
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Discrete
from rpil.inference.channels import own_log_prob
from rpil.inference.held_out import held_out_model, indicators, log_reference
from rpil.inference.scores import Scoring, TrimmedFit, dependence, monotony
from rpil.inference.settings import HeldOutSettings, JudgeSettings

SETTINGS = JudgeSettings()


@pytest.mark.parametrize("discrete", [False, True])
def test_scores_by_hand(discrete):
    offsets, n = np.array([0, 40, 70, 120]), 120
    rng = np.random.default_rng(0)
    actions = rng.integers(2, size=n) if discrete else rng.normal(size=(n, 1))
    space = Discrete(2) if discrete else Box.around(actions)
    data = FitData(np.ones((n, 1)), actions, offsets, space, np.zeros(3, dtype=int))
    log_q = rng.normal(size=n)
    model, best = Written(data, lambda group: 0.0, SETTINGS), log_q + 0.1
    scoring = Scoring(data, model, SETTINGS, 0.1, log_q, best, np.zeros(3))
    group, log_prob = np.array([True, False, True]), rng.normal(size=n)
    found = scoring.score(TrimmedFit(log_prob, group, 0.1, np.zeros(1)))
    log_ratio = log_prob - log_q if discrete else log_prob
    of_each = np.split(log_ratio, offsets[1:-1])
    np.testing.assert_allclose(found.score, [one.mean() for one in of_each])
    squares = np.array([((one - one.mean()) ** 2).sum() for one in of_each])
    assert found.step_variance == pytest.approx(squares.sum() / 117)
    pooled = found.step_variance
    np.testing.assert_allclose(found.variance, (squares + 20 * pooled) / (data.lengths + 20) / data.lengths)
    few = [0.0, pooled * (1 / 30 - 1 / 40), 0.0]
    np.testing.assert_allclose(found.excess, dependence(data, log_ratio, squares) + few)
    assert found.state_predicts_action is bool(np.median(data.mean_steps(log_prob - best)[group]) > 0.1)
    np.testing.assert_array_equal(found.log_odds, found.groups.log_odds(found.score, found.variance))


def test_one_step_each_has_no_variance_of_steps():
    data = FitData(np.ones((3, 1)), np.array([0, 1, 0]), np.arange(4), Discrete(2), np.zeros(3, dtype=int))
    model, nothing = Written(data, lambda group: 0.0, SETTINGS), np.zeros(3)
    scoring = Scoring(data, model, SETTINGS, 0.1, nothing, nothing, nothing)
    fit = TrimmedFit(np.arange(3.0), np.ones(3, dtype=bool), 0.1, np.zeros(1))
    assert scoring.score(fit).step_variance == 0.0


GAINS = np.array([1.0, -9.0, 3.0, 2.0])


@pytest.mark.parametrize(("limit", "sign", "predicts"), [(1.9, 1, True), (2.1, 1, False), (0.1, -1, False)])
def test_the_state_predicts_the_actions_of_the_training_group(limit, sign, predicts):
    data = same_actions(4)
    best = log_reference(data, np.ones(4, dtype=bool), SETTINGS.held_out, best=True)
    lead = float(np.mean(best - reference(data, SETTINGS)))  # of the best reference, in every demonstration
    settings = replace(SETTINGS, min_gain=limit)
    scoring = Scoring.of(data, Written(data, lambda group: sign * GAINS + lead, settings), settings)
    group = np.array([True, False, True, True])
    assert scoring.score(scoring.fit(group)).state_predicts_action is predicts
    assert scoring.ridge == 0.0
    np.testing.assert_allclose(scoring.log_q, reference(data, settings))
    assert [one.tolist() for one in scoring.model.fitted] == [group.tolist()]


@pytest.mark.parametrize(("gain", "predicts"), [(0.006, True), (0.004, False)])
def test_of_actions_that_are_rare_a_share_of_their_entropy_is_enough(gain, predicts):
    data = FitData(np.ones((6, 1)), np.zeros(6, dtype=int), np.array([0, 2, 4, 6]), Discrete(2), np.zeros(3, dtype=int))
    log_q = np.full(6, -0.05)
    scoring = Scoring(data, Written(data, lambda group: 0.0, SETTINGS), SETTINGS, 0.1, log_q, log_q, np.zeros(3))
    fit = TrimmedFit(log_q + gain, np.ones(3, dtype=bool), 0.1, np.zeros(1))
    assert scoring.score(fit).state_predicts_action is predicts


def test_what_is_easy_to_predict_without_the_state_must_be_explained_better():
    problem = make_continuous("none", 0, steps=(40, 60)).problem()
    weak = problem.per_step(np.arange(problem.n_demonstrations) == 2)
    problem = replace(problem, actions=np.where(weak[:, None], 1e-3 * problem.actions, problem.actions))
    scoring = Scoring.of(problem, held_out_model(problem, HeldOutSettings()), SETTINGS)
    own = own_log_prob(problem, indicators(problem), SETTINGS.held_out.errors)
    assert scoring.typical_own == pytest.approx(np.median(own))
    less = monotony(scoring.own, scoring.typical_own, SETTINGS)
    np.testing.assert_allclose(less, np.maximum(own - np.median(own), 0.0) / 3)
    scores = scoring.score(scoring.fit(np.ones(problem.n_demonstrations, dtype=bool)))
    explained = problem.mean_steps(scores.fit.log_prob)
    np.testing.assert_allclose(scores.score, explained - less)
    assert scores.score.argmin() == 2
