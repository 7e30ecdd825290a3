"""P(expert) before the actions: the mode of what it claims, and a slope that needs evidence."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit, log_expit
from scipy.stats import beta

from rpil.priors import ByLength, Share

LENGTHS = np.array([10, 12, 15, 20, 30, 80, 200])


def test_the_share_is_the_mode():
    expert = np.array([1.0, 1.0, 0.5, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    found = Share(0.5, 3.0, 2.0).fit(expert, np.ones(10))
    grid = np.linspace(1e-6, 1 - 1e-6, 1_000_001)
    log_posterior = (6.5 + 3 - 1) * np.log(grid) + (3.5 + 2 - 1) * np.log1p(-grid)
    assert found.p == pytest.approx(grid[log_posterior.argmax()], abs=2e-6)
    np.testing.assert_allclose(np.exp(found.log(np.ones(3))), [[found.p, 1 - found.p]] * 3)
    assert found.log_prior() == pytest.approx(2 * np.log(found.p) + np.log1p(-found.p))


def test_a_given_share_stays():
    fixed = Share(0.2, fixed=True)
    assert fixed.fit(np.ones(9), np.ones(9)).p == 0.2
    assert fixed.log_prior() == 0.0
    assert fixed.alternatives(np.ones(3))[0].tolist() == [0.0]
    assert 0 < Share(0.5, 1.0, 1.0).fit(np.zeros(10), np.ones(10)).p < 1e-9  # never exactly 0


def penalised(prior: ByLength, expert: np.ndarray) -> float:
    log_odds = prior.log_odds(LENGTHS)
    return float(expert @ log_expit(log_odds) + (1 - expert) @ log_expit(-log_odds)) + prior.log_prior()


@pytest.mark.parametrize("seed", range(5))
def test_the_slope_is_the_mode(seed):
    expert = np.random.default_rng(seed).uniform(size=7)
    start = ByLength.start(LENGTHS, 3.0, 2.0)
    found = start.fit(expert, LENGTHS)

    def loss(theta: np.ndarray) -> float:
        return -penalised(ByLength(start.center, start.scale, *theta, a=3.0, b=2.0), expert)

    best = minimize(loss, np.zeros(2), tol=1e-12)
    np.testing.assert_allclose([found.intercept, found.slope], best.x, atol=1e-4)


def test_a_fit_never_falls_even_from_far():
    expert = np.array([1.0, 1, 1, 1, 0, 0, 0])
    far = ByLength(np.log(30), 1.0, 20.0, 15.0)
    assert penalised(far.fit(expert, LENGTHS), expert) > penalised(far, expert)


def test_length_says_nothing_where_trust_does_not_depend_on_it():
    prior = ByLength.start(LENGTHS).fit(np.full(7, 0.5), LENGTHS)
    assert prior.slope == pytest.approx(0.0, abs=1e-9)
    assert prior.p == pytest.approx(0.5)


def test_the_same_length_for_all_is_the_share():
    expert = np.array([1.0, 1, 1, 1, 0])
    same = np.full(5, 200)
    found = ByLength.start(same).fit(expert, same)
    np.testing.assert_allclose(found.p, Share().fit(expert, same).p)
    np.testing.assert_allclose(found.log(same), Share().fit(expert, same).log(same))
    assert found.slope == 0.0


def test_the_long_are_trusted_less_where_those_known_to_be_bad_are_long():
    prior = ByLength.start(LENGTHS).fit(np.array([1.0, 1, 1, 1, 1, 0, 0]), LENGTHS)
    assert prior.slope < -1
    log_odds = prior.log_odds(np.array([10, 200, 100_000]))
    assert log_odds[0] > 0 > log_odds[1]
    assert log_odds[2] == pytest.approx(
        prior.intercept + 2 * prior.slope
    )  # two standard deviations are as far as a line is believed


@pytest.mark.parametrize("n", [2, 20, 2000])
@pytest.mark.parametrize("prior", [Share(0.3), ByLength.start(LENGTHS, 3.0, 2.0)], ids=["share", "by length"])
def test_alternatives_integrate_as_the_beta_posterior(prior, n):
    """With n clear demonstrations, so many of them experts, the grid has the posterior's moments."""
    lengths = np.full(n, 30)
    n_expert = max(1, int(0.3 * n))
    prior = prior.fit(np.arange(n) < n_expert, lengths)
    shift, log_prior = prior.alternatives(lengths)
    log_odds = prior.log_odds(np.array([30])) + shift
    log_weight = log_prior + n_expert * log_expit(log_odds) + (n - n_expert) * log_expit(-log_odds)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    share = expit(log_odds)
    if isinstance(prior, Share):
        posterior = beta(prior.a + n_expert, prior.b + n - n_expert)
        assert weight @ share == pytest.approx(posterior.mean(), rel=2e-3)
        assert np.sqrt(weight @ (share - weight @ share) ** 2) == pytest.approx(posterior.std(), rel=2e-2)
    assert weight[[0, -1]].max() < 1e-3  # nothing is cut off
