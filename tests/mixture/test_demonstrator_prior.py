"""The prior of demonstrators: exact sums, shrinkage, and little effect of demonstrators that are random."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.special import log_expit, logsumexp

from rpil.data.fit_data import Demonstrators
from rpil.mixture.demonstrator_prior import demonstrator_posterior, trust_by_demonstrator
from rpil.mixture.settings import DemonstratorSettings

SPREADS = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0])
NODES = np.linspace(-3.0, 3.0, 25)
LOG_WEIGHT = -0.5 * NODES**2 - np.log(np.exp(-0.5 * NODES**2).sum())


def log_prior(demonstrators: Demonstrators, expert: tuple[int, ...]) -> float:
    """log P(which demonstrations are experts'), summed over each tau and each intercept."""
    z = SPREADS[:, None] * NODES
    each = np.where(np.array(expert)[:, None, None], log_expit(z), log_expit(-z))
    sums = [each[demonstrators.index == u].sum(axis=0) for u in range(len(demonstrators.names))]
    return float(logsumexp(sum(logsumexp(s + LOG_WEIGHT, axis=1) for s in sums)) - np.log(len(SPREADS)))


@pytest.mark.parametrize("labels", [[0] * 6, [0, 0, 1, 0, -1, 0]], ids=["unlabelled", "labelled"])
def test_log_odds_are_those_of_enumeration(labels):
    demonstrators, labels = Demonstrators.from_names("aabbbc"), np.array(labels)
    ratio = 2 * np.random.default_rng(0).normal(size=6)
    posterior = demonstrator_posterior(demonstrators, ratio, labels, DemonstratorSettings())
    experts = np.array(list(product([0, 1], repeat=6)))
    joint = np.array([log_prior(demonstrators, tuple(row)) for row in experts])
    assert logsumexp(joint) == pytest.approx(0.0)
    joint = joint + experts @ ratio
    fits = (experts == (labels > 0)) | (labels == 0)
    for m in range(6):
        others = np.delete(fits, m, axis=1).all(axis=1)
        without = joint - experts[:, m] * ratio[m]  # without the actions of m
        odds = [logsumexp(without[others & (experts[:, m] == z)]) for z in (1, 0)]
        assert posterior.log_odds[m] == pytest.approx(odds[0] - odds[1], abs=1e-4)


def test_shrinkage_by_the_number_of_demonstrations():
    demonstrators = Demonstrators.from_names(["eight"] * 9 + ["two"] * 3 + ["none"] + ["bad"] * 6)
    ratio = np.array([30.0] * 8 + [0.0] + [30.0] * 2 + [0.0] + [0.0] + [-30.0] * 6)
    posterior = demonstrator_posterior(demonstrators, ratio, np.zeros(19, dtype=int), DemonstratorSettings())
    eight, two, none, bad = posterior.log_odds[[8, 11, 12, 13]]
    assert eight > two + 0.3 > none + 0.6
    assert none == 0.0
    assert bad < -0.8
    mean, low, high = posterior.intervals().T
    assert (np.diff(mean) < 0).all()
    assert (low <= mean).all()
    assert (mean <= high).all()
    assert high[2] - low[2] > high[0] - low[0]


def test_copies_count_once_for_each_demonstrator_who_gave_them():
    """The last two are copies of the first two, one by its demonstrator and one by another."""
    ratio, settings = np.array([3.0, 1.0, 2.0, -1.0, -4.0, -2.0, 3.0, 1.0]), DemonstratorSettings()
    names, copy_of, labels = "aaabbbab", np.array([0, 1, 2, 3, 4, 5, 0, 1]), np.zeros(8, dtype=int)
    found, trust = trust_by_demonstrator(Demonstrators.from_names(names), ratio, labels, copy_of, settings)
    once = [0, 1, 2, 3, 4, 5, 7]
    by_hand = demonstrator_posterior(Demonstrators.from_names("aaabbbb"), ratio[once], labels[once], settings)
    np.testing.assert_allclose(found[once], by_hand.log_odds)
    assert found[6] == found[0]
    np.testing.assert_allclose(trust, by_hand.intervals())


def test_demonstrators_that_do_not_differ_or_tell_nothing_change_nothing():
    ratio, settings = np.array([9.0, 9, -9, -9]), DemonstratorSettings(spreads=(0.0,))
    posterior = demonstrator_posterior(Demonstrators.from_names("aabb"), ratio, np.zeros(4, dtype=int), settings)
    np.testing.assert_allclose(posterior.log_odds, 0.0, atol=1e-9)
    np.testing.assert_allclose(posterior.intervals(), 0.5)
    for names in (Demonstrators(), Demonstrators.from_names("aaaa"), Demonstrators.from_names("abcd")):
        given = np.ones(4), np.zeros(4, dtype=int), np.arange(4), DemonstratorSettings()
        found, trust = trust_by_demonstrator(names, *given)
        assert not found.any()
        assert trust.shape == (0, 3)
