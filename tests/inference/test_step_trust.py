"""Reliability of demonstrations and trust in steps."""

from __future__ import annotations

import numpy as np

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.settings import JudgeSettings
from rpil.inference.step_trust import step_trust


def test_reliability_is_the_share_of_steps_that_follow_the_policy():
    rng = np.random.default_rng(0)
    n_steps, share = 2000, np.array([0.1, 0.5, 0.9])
    follows = rng.random((3, n_steps)) < share[:, None]
    log_ratio = np.where(follows, np.log(0.9 / 0.25), np.log(0.1 / 3 / 0.25)).ravel()
    ones, zeros = np.ones((3 * n_steps, 1)), np.zeros(3 * n_steps, dtype=int)
    problem = FitData(ones, zeros, np.arange(4) * n_steps, Discrete(4), np.zeros(3, dtype=int))
    # An expert's step has the likelihood ratio of its action, and so has another step that happens to agree.
    trust = step_trust(problem, log_ratio, np.ones(3), JudgeSettings())
    assert (np.diff(trust.reliability) > 0.2).all()
    assert (trust.interval[:, 0] <= trust.reliability + 1e-9).all()
    assert (trust.interval[:, 1] >= trust.reliability - 1e-9).all()
    assert trust.step[follows.ravel()].mean() > trust.step[~follows.ravel()].mean() + 0.3
    wide = step_trust(problem, log_ratio, np.full(3, 0.01), JudgeSettings()).interval
    assert (np.ptp(wide, axis=1) > np.ptp(trust.interval, axis=1)).all()
