"""Reliability of demonstrations, and which of their steps are an expert's."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.settings import JudgeSettings
from rpil.inference.step_trust import reliability_of, step_proba


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


def test_reliability_is_that_of_a_sum_over_the_grid_and_log_ratios_are_bounded():
    problem = FitData(np.ones((5, 1)), np.zeros(5, int), np.array([0, 3, 5]), Discrete(2), np.zeros(2, int))
    log_ratio, nodes = np.array([1.0, -2.0, 0.5, -9.0, 4.0]), (np.arange(7) + 0.5) / 7
    settings = JudgeSettings(reliability_nodes=7, max_log_ratio=3.0)
    found, interval = reliability_of(problem, log_ratio, settings)
    for m, own in enumerate(([1.0, -2.0, 0.5], [-3.0, 3.0])):
        joint = np.prod([rho * np.exp(own) + 1 - rho for rho in nodes], axis=1)
        cumulated = np.cumsum(joint) / joint.sum()
        assert found[m] == pytest.approx(joint @ nodes / joint.sum())
        ends = [nodes[np.flatnonzero(cumulated >= q)[0]] for q in (0.025, 0.975)]
        np.testing.assert_allclose(interval[m], ends)


DEFAULT = JudgeSettings()


def summed_over_paths(share: float, log_ratio: np.ndarray, settings: JudgeSettings) -> np.ndarray:
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


@pytest.mark.parametrize("settings", [DEFAULT, JudgeSettings(stay=0.6, p_stretches=0.9)])
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
