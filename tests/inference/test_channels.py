"""Each channel on three demonstrations, by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Discrete
from rpil.inference.channels import (
    CHANNELS,
    channels,
    columns_of,
    components,
    normal_scores,
    own_log_prob,
    spaced,
    spread_of,
    summaries,
)
from rpil.inference.settings import ChannelSettings
from rpil.numerics.regression import ErrorSettings, student_log_densities

SETTINGS, ERRORS = ChannelSettings(), ErrorSettings()
STATES = np.array([[0.0, 0], [1, 0], [2, 0], [2, 0], [4, 0], [4, 3], [0, 0], [0, 1]])
OFFSETS = np.array([0, 4, 6, 8])
ACTIONS = np.array([[0.0], [1], [3], [3], [5], [1], [2], [2]])
LOG_RATIO = np.array([0.0, -2, 0, -2, -3, -5, -1, -2])


def data_of(states=STATES, actions=ACTIONS, offsets=OFFSETS) -> FitData:
    features = np.column_stack([states, np.ones(len(states))])
    discrete = actions.ndim == 1
    space = Discrete(int(actions.max()) + 1) if discrete else Box.around(actions)
    return FitData(features, actions, offsets, space, np.zeros(len(offsets) - 1, dtype=int))


def described(data, actions=None):
    actions = np.asarray(data.actions if actions is None else actions, dtype=float)
    found = channels(data, LOG_RATIO, actions, spread_of(data))
    return dict(zip(CHANNELS[1:], found.T, strict=True))


def test_channels_of_likelihood_and_length():
    found = described(data_of())
    np.testing.assert_allclose(found["gain"], [-1, -4, -1.5])
    np.testing.assert_allclose(found["length"], np.log([4, 2, 2]))


def test_discrete_actions_are_compared_with_frequencies():
    actions = np.array([0, 0, 0, 1, 1, 1, 2, 0])
    data, taken = data_of(actions=actions), np.eye(3)[actions]
    found = described(data, taken)
    np.testing.assert_allclose(found["gain"], [-1, -4, -1.5])
    # one step of every action is added: 4, 2, 1 of 7; 1, 3, 1 of 5; 2, 1, 2 of 5
    own = [(3 * np.log(4 / 7) + np.log(2 / 7)) / 4, np.log(3 / 5), np.log(2 / 5)]
    np.testing.assert_allclose(own_log_prob(data, taken, ERRORS), own)
    np.testing.assert_allclose(found["smoothness"], [-2 / 3, 0, -2])


def test_own_actions_are_a_student_distribution_around_their_median():
    own = []
    for errors in (np.array([-2.0, -1, 1, 1]), np.array([2.0, -2]), np.zeros(2)):
        scale = np.array([1.35 * np.median(np.abs(errors)) + 0.03])
        own.append(student_log_densities(errors[:, None], scale, ERRORS).sum(axis=1).mean())
    np.testing.assert_allclose(own_log_prob(data_of(), ACTIONS, ERRORS), own)


def test_smoothness_is_the_mean_change_of_all_parts_of_the_action():
    np.testing.assert_allclose(described(data_of())["smoothness"], [-1, -4, 0])
    both = np.hstack([ACTIONS, -2 * ACTIONS])
    np.testing.assert_allclose(described(data_of(actions=both))["smoothness"], [-3, -12, 0])


def test_moves_are_in_standard_deviations_of_the_states():
    data = data_of()
    spread = spread_of(data)
    np.testing.assert_allclose(spread, [STATES[:, 0].std(), STATES[:, 1].std(), 1.0])
    x, y = 1 / spread[:2]
    np.testing.assert_allclose(described(data)["short path"], [-2 * x, -3 * y, -y])


def test_shifts_and_units_of_states_and_a_constant_one_change_nothing():
    others = data_of(STATES * [1e3, 0.01] + [7, -300]), data_of(np.column_stack([STATES, np.full(8, 5.0)]))
    for name, values in described(data_of()).items():
        for other in others:
            np.testing.assert_allclose(described(other)[name], values, rtol=1e-6, atol=1e-9, err_msg=name)


def test_demonstrations_of_one_step():
    data = data_of(STATES, ACTIONS, np.arange(9))
    found = described(data)
    for name in ("short path", "smoothness", "length"):
        np.testing.assert_array_equal(found[name], 0.0)


def test_normal_scores_are_quantiles_of_ranks():
    values = np.array([[3.0, 1.0], [1.0, 1.0], [2.0, 1.0], [1.0, 1.0]])
    found = normal_scores(values)
    np.testing.assert_allclose(found[:, 0], norm.ppf([3.5 / 4, 1 / 4, 2.5 / 4, 1 / 4]))
    np.testing.assert_allclose(found[:, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(normal_scores(np.exp(values) * 7), found)


def test_columns_are_the_ranking_normal_scores_components_and_the_group():
    log_odds, seen = np.array([7.0, -1.5, -9.0]), np.array([[0.1], [0.4], [0.2]])
    found = columns_of(log_odds, np.array([[3.0], [9.0], [1.0]]), seen, np.array([2.0, 6.0, 1.0]))
    np.testing.assert_allclose(found[:, 0], np.arcsinh(np.array([4, 0, -1]) / 1.4826))  # the highest is the first
    np.testing.assert_allclose(found[:, 1], norm.ppf([1 / 2, 5 / 6, 1 / 6]), atol=1e-12)
    np.testing.assert_allclose(found[:, 2:], np.column_stack([seen, np.arcsinh(log_odds)]))


@pytest.mark.parametrize(
    ("ranking", "score", "expected"),
    [
        ([3, 3, 1, 4], [0, 1, 2, 9], [0, 0, -1.5 / 1.4826, 7.5 / 1.4826]),  # two share their places
        ([1, 2, 3, 4, 5], [0, 0, 0, 0, 5], [0, 0, 0, 0, 25]),  # a tenth of the standard deviation
        ([1, 2, 3, 4, 5], [0, 1e-16, 2e-16, 3e-16, 5], [0, 0, 0, 0, 25]),  # so is what is rounding
        ([1, 2, 3], [4, 4, 4], [0, 0, 0]),
    ],
)
def test_the_ranking_is_spaced_as_the_scores_are(ranking, score, expected):
    found = spaced(np.array(ranking, dtype=float), np.array(score, dtype=float))
    np.testing.assert_allclose(found, np.arcsinh(expected), atol=1e-12)


@pytest.mark.parametrize(("size", "most"), [(4, 3), (30, 8)])  # the scores are centred: four have three components
def test_components_are_those_of_the_summaries_by_hand(size, most):
    """Of demonstrations of two steps: one state and one action, each with five summaries."""
    rng = np.random.default_rng(0)
    states, actions = rng.normal(size=(2 * size, 1)), rng.normal(size=(2 * size, 1))
    data = data_of(states, actions, np.arange(0, 2 * size + 1, 2))
    pairs = np.concatenate([np.stack([values[::2, 0], values[1::2, 0]], axis=1)[None] for values in (states, actions)])
    of_each = [(p.mean(axis=1), p.std(axis=1), p[:, 0], p[:, 1], np.abs(p[:, 1] - p[:, 0])) for p in pairs]
    scores = normal_scores(np.stack([column for columns in of_each for column in columns], axis=1))
    left, sizes, loadings = np.linalg.svd(scores, full_matrices=False)
    for n in (2, 8):
        found = components(summaries(data, actions), replace(SETTINGS, n_components=n))
        count = min(n, most)
        assert found.shape == (size, count)
        assert found[:, 0].std() == pytest.approx(1.0)
        sign = np.sign([row[np.abs(row).argmax()] for row in loadings])
        by_hand = (left * sizes * sign)[:, :count] * np.sqrt(size) / sizes[0]
        np.testing.assert_allclose(found, by_hand, atol=1e-9)
    assert components(0 * summaries(data, actions), SETTINGS).shape == (size, 0)
