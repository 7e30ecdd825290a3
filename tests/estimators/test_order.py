"""The order of demonstrations in the data changes nothing that an audit says."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.data.demonstrations import Demonstrations
from rpil.estimators.rpil import RPIL


def small_world(seed):
    """Eight to fifteen demonstrations of a few dozen steps, some of which act at random: most are hard to judge."""
    rng = np.random.default_rng(seed)
    n, n_steps, n_columns, n_actions = (int(rng.integers(*ends)) for ends in ((8, 16), (10, 50), (2, 6), (2, 5)))
    observations = rng.normal(size=(n * n_steps, n_columns))
    groups = np.repeat(np.arange(n), n_steps)
    bad = groups >= n - int(rng.integers(1, n // 2))
    if seed % 3 == 2:
        actions = observations[:, :2] + 0.3 * rng.normal(size=(n * n_steps, 2))
        actions[bad] = rng.normal(size=(bad.sum(), 2))
    else:
        logits = 2 * np.hstack([observations] * 3)[:, :n_actions]
        actions = np.argmax(logits + rng.gumbel(size=logits.shape), axis=1)
        actions[bad] = rng.integers(0, n_actions, bad.sum())
    return Demonstrations.from_groups(observations, actions, groups)


@pytest.mark.parametrize("seed", [2, 5, 18, 19, 30, 33, 52])
def test_the_order_of_demonstrations_changes_no_word_finding_doubt_or_pair(seed):
    data = small_world(seed)
    said, log_odds = [], []
    for order in (np.arange(len(data)), np.random.default_rng(0).permutation(len(data))):
        audit = RPIL("raw").fit(data.select(order)).audit_
        said.append((audit.finding, dict(zip(audit.ids, audit.verdicts, strict=True)), audit.doubts, audit.pair))
        log_odds.append(audit.log_odds[np.argsort(order)])
    assert said[1] == said[0]
    np.testing.assert_allclose(log_odds[1], log_odds[0], rtol=0, atol=1e-6)
