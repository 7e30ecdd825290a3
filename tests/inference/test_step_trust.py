"""Reliability of demonstrations, and shares of steps in them."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.special import logit

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.settings import JudgeSettings, StepSettings
from rpil.inference.step_trust import balanced, reliability_of, step_proba, step_shares


def test_reliability_is_the_share_of_steps_that_follow_the_policy():
    rng = np.random.default_rng(0)
    n_steps, share = 2000, np.array([0.1, 0.5, 0.9])
    follows = rng.random((3, n_steps)) < share[:, None]
    log_ratio = np.where(follows, np.log(0.9 / 0.25), np.log(0.1 / 3 / 0.25)).ravel()
    ones, zeros = np.ones((3 * n_steps, 1)), np.zeros(3 * n_steps, dtype=int)
    problem = FitData(ones, zeros, np.arange(4) * n_steps, Discrete(4), np.zeros(3, dtype=int))
    # An expert's step has the likelihood ratio of its action, and so has another step that happens to agree.
    reliability, interval = reliability_of(problem, log_ratio, JudgeSettings())
    assert (np.diff(reliability) > 0.2).all()
    assert (interval[:, 0] <= reliability + 1e-9).all()
    assert (interval[:, 1] >= reliability - 1e-9).all()


def test_a_demonstration_whose_steps_are_alike_has_equal_shares():
    problem = FitData(np.ones((5, 1)), np.zeros(5, int), np.array([0, 3, 5]), Discrete(2), np.zeros(2, int))
    share = step_shares(problem, np.array([-4.0, -4.0, -4.0, 60.0, 60.0]), JudgeSettings(), 1.0)
    np.testing.assert_allclose(share, 0.5, atol=0.01)  # a step at an end has one neighbour only


def test_a_reliable_demonstration_is_taken_whole():
    problem = FitData(np.ones((8, 1)), np.zeros(8, int), np.array([0, 4, 8]), Discrete(2), np.zeros(2, int))
    log_ratio = np.array([4.0, 4.0, -4.0, 4.0, -4.0, -4.0, 4.0, -4.0])
    reliability = reliability_of(problem, log_ratio, JudgeSettings())[0]
    assert reliability[0] > 0.5 > reliability[1]
    share = step_shares(problem, log_ratio, JudgeSettings(), 0.5)
    np.testing.assert_array_equal(share[:4], 0.5)
    assert share[6] > 0.8 > 0.5 > share[[4, 5, 7]].max()


@pytest.mark.parametrize("seed", range(2))
def test_shares_have_a_mean_of_one_half_and_keep_the_order_and_the_differences_in_log_odds(seed):
    rng = np.random.default_rng(seed)
    lengths = rng.integers(1, 40, size=6)
    log_odds = rng.normal(size=lengths.sum()) * rng.choice([0.1, 3.0, 20.0])
    share, ends = balanced(log_odds, lengths), np.cumsum(lengths)[:-1]
    for mine, before in zip(np.split(share, ends), np.split(log_odds, ends), strict=True):
        assert mine.mean() == pytest.approx(0.5, abs=1e-6)
        inner = (mine > 1e-6) & (mine < 1 - 1e-6)
        np.testing.assert_allclose(np.diff(logit(mine[inner])), np.diff(before[inner]), atol=1e-3)


DEFAULT = StepSettings()


def summed_over_paths(share: float, log_ratio: np.ndarray, settings: StepSettings) -> np.ndarray:
    """P(each step is an expert's), by a sum over all sequences of good and bad steps, in stretches and alone."""
    total, good = 0.0, np.zeros(len(log_ratio))
    priors = {settings.stay: settings.p_stretches, 0.0: 1 - settings.p_stretches}
    for stay, *path in product(priors, *[(0, 1)] * len(log_ratio)):
        weight = priors[stay]
        for n, z in enumerate(path):
            anew = share if z else 1 - share
            weight *= (stay * (z == path[n - 1]) + (1 - stay) * anew if n else anew) * np.exp(z * log_ratio[n])
        total += weight
        good += weight * np.array(path)
    return good / total


@pytest.mark.parametrize("settings", [DEFAULT, StepSettings(stay=0.6, p_stretches=0.9)])
def test_steps_are_judged_as_a_sum_over_all_sequences_does(settings):
    """In demonstrations of different lengths side by side."""
    lengths, share = np.array([3, 7, 1, 5]), np.array([0.3, 0.9, 0.5, 0.02])
    log_ratio = 2 * np.random.default_rng(0).normal(size=lengths.sum())
    found = np.split(step_proba(share, log_ratio, lengths, settings), np.cumsum(lengths)[:-1])
    for m, own in enumerate(np.split(log_ratio, np.cumsum(lengths)[:-1])):
        np.testing.assert_allclose(found[m], summed_over_paths(share[m], own, settings), rtol=1e-12)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_certain_demonstrations_and_steps_give_finite_weights(share):
    found = step_proba(np.array([share]), np.array([50.0, -50.0, 50.0, -50.0]), np.array([4]), DEFAULT)
    assert ((found >= 0) & (found <= 1)).all()
