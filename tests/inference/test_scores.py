"""Variances of scores."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.inference.scores import mean_variance


def test_mean_variance_is_that_of_simulated_means():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(4000, 25))
    squares = ((values - values.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
    variance = mean_variance(squares, np.full(4000, 25), 1.0, np.full(4000, 25.0), 20.0)
    assert variance.mean() == pytest.approx(values.mean(axis=1).var(), rel=0.1)
