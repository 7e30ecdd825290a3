"""Weights of steps."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.results.settings import AuditSettings
from rpil.results.step_weights import is_anyone_trusted, step_weight, typical_reliability

LENGTHS = np.array([2, 1, 1])


def test_reliable_demonstrations_have_the_full_weight_and_others_that_of_their_steps():
    proba, reliability = np.array([0.8, 0.9, 0.5]), np.array([0.9, 0.95, 0.3])
    step = np.array([0.1, 0.2, 0.3, 0.4])
    found = step_weight(LENGTHS, proba, reliability, step, AuditSettings())
    assert found == pytest.approx([0.8, 0.8, 0.9, 0.5 * 0.4])


def test_without_steps_there_are_no_weights():
    assert step_weight(LENGTHS, np.ones(3), np.ones(3), np.empty(0), AuditSettings()).size == 0


def test_the_typical_reliability_is_a_median_weighted_by_proba():
    assert typical_reliability(np.array([0.2, 0.9, 0.5]), np.array([0.1, 0.1, 1.0]), LENGTHS) == 0.5
    assert typical_reliability(np.array([0.2, 0.9, 0.5]), np.full(3, 0.1), LENGTHS) == 1.0
    assert not is_anyone_trusted(np.full(3, 0.1), LENGTHS)
    assert is_anyone_trusted(np.full(3, 0.25), LENGTHS)
