"""The share of experts: the mode under its Beta prior, and the interval of its posterior."""

import numpy as np
import pytest
from scipy.stats import beta

from rpil.mixture.expert_prior import ExpertPrior, as_prior

EXPERT = np.array([1.0, 1.0, 0.5, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def test_prior_is_fitted_at_its_posterior_mode():
    found = ExpertPrior(0.5, 3.0, 2.0).fit(EXPERT)
    grid = np.linspace(1e-6, 1 - 1e-6, 1_000_001)
    log_posterior = (6.5 + 3 - 1) * np.log(grid) + (3.5 + 2 - 1) * np.log1p(-grid)
    assert found.p == pytest.approx(grid[log_posterior.argmax()], abs=2e-6)
    np.testing.assert_allclose(np.exp(found.log), [found.p, 1 - found.p])
    assert found.log_prior() == pytest.approx(2 * np.log(found.p) + np.log1p(-found.p))


def test_fixed_prior_is_not_fitted():
    fixed = ExpertPrior(0.2, fixed=True)
    assert (fixed.fit(np.ones(9)).p, fixed.log_prior()) == (0.2, 0.0)
    assert fixed.interval(np.ones(9)) == (0.2, 0.2, 0.2)
    assert 0 < ExpertPrior(0.5, 1.0, 1.0).fit(np.zeros(10)).p < 1e-9  # never exactly 0


@pytest.mark.parametrize("expert", [EXPERT, np.ones(2), np.zeros(2000)])
def test_interval_is_that_of_the_beta_posterior(expert):
    posterior = beta(3.0 + expert.sum(), 2.0 + len(expert) - expert.sum())
    expected = posterior.mean(), *posterior.ppf([0.025, 0.975])
    np.testing.assert_allclose(ExpertPrior(0.5, 3.0, 2.0).interval(expert), expected)


def test_as_prior_takes_a_probability_or_a_beta_prior():
    assert (as_prior(None), as_prior(0.3)) == (ExpertPrior(), ExpertPrior(0.3, fixed=True))
    assert as_prior((3.0, 1.0)) == ExpertPrior(0.75, 3.0, 1.0)
