"""Effective steps against autoregressions, whose autocovariances are known."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.inference.effective_steps import autocovariances, effective_steps
from rpil.inference.settings import EffectiveStepsSettings


def series(rng, n_series, n, r, lag=1):
    """Autoregressions x_t = r x_{t - lag} + noise with variance one, (n_series, n)."""
    x = rng.normal(size=(n_series, n))
    for t in range(lag, n):
        x[:, t] = r * x[:, t - lag] + np.sqrt(1 - r * r) * rng.normal(size=n_series)
    return x


def true_effective(r, n, lag=1):
    k = np.arange(1, n)
    correlation = np.where(k % lag == 0, float(r) ** (k // lag), 0.0)
    return n / (1 + 2 * ((1 - k / n) * correlation).sum())


@pytest.mark.parametrize("lag", [1, 2])
@pytest.mark.parametrize("r", [-0.5, 0.0, 0.3, 0.6, 0.9, 0.95])
@pytest.mark.parametrize("n", [3, 10, 100, 1000])
def test_effective_steps_of_autoregressions(r, n, lag):
    rng, n_series = np.random.default_rng(0), max(60, 6000 // n)
    found = []
    for _ in range(4):
        x = series(rng, n_series, n, r, lag)
        covariances = autocovariances(x.ravel(), np.arange(n_series + 1) * n, EffectiveStepsSettings())
        found.append(effective_steps(covariances, np.array([n]))[0])
    assert np.mean(found) == pytest.approx(true_effective(r, n, lag), rel=0.25)


def test_residuals_of_a_right_policy_are_independent_where_states_move_slowly():
    rng = np.random.default_rng(0)
    state = series(rng, 40, 200, 0.99).ravel()
    proba = 1 / (1 + np.exp(-3 * state))
    action = rng.random(len(state)) < proba
    log_prob = np.log(np.where(action, proba, 1 - proba))
    expected = proba * np.log(proba) + (1 - proba) * np.log(1 - proba)
    offsets = np.arange(41) * 200
    for residual, low, high in ((log_prob - expected, 0.95, np.inf), (log_prob - log_prob.mean(), 0.0, 0.8)):
        covariances = autocovariances(residual, offsets, EffectiveStepsSettings())
        assert low <= effective_steps(covariances, np.array([200]))[0] / 200 < high
