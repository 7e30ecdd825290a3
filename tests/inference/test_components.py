"""Components as columns from which answers learn, and answers that follow nothing."""

from __future__ import annotations

import numpy as np

from rpil.inference.answers import Answers, posterior
from rpil.inference.channels import CHANNELS
from rpil.inference.settings import AnswerSettings

SETTINGS = AnswerSettings()


def with_components(seed=0):
    """48 demonstrations whose quality is in the second of three components, and in nothing else."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(48, len(CHANNELS) + 4))
    good = columns[:, len(CHANNELS) + 1] > 0
    columns[:, len(CHANNELS) + 1] += np.where(good, 1.0, -1.0)
    return columns, good


def test_components_count_as_far_as_answers_support_them():
    columns, good = with_components()
    labels = np.where(np.arange(48) < 12, 2 * good - 1, 0)
    told = posterior(columns, Answers.of_labels(labels), SETTINGS)
    rest = told.proba(columns)[12:]
    assert np.mean(rest[good[12:]][:, None] > rest[~good[12:]]) > 0.9
    weights = np.exp(told.log_weight).reshape(3, 2, 2)  # directions, without components and with them, error rates
    assert weights[:, 1].sum() > 0.9
    alone = posterior(columns, Answers.of_labels(labels * good), SETTINGS)
    assert len(alone.mean) == 2 * len(SETTINGS.error_rates)
    np.testing.assert_allclose(alone.mean[:, 1 + len(CHANNELS) : -1], 0.0, atol=1e-3)
