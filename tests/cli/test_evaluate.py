"""``rpil evaluate``: returns and successes, Gymnasium and Meta-World."""

from __future__ import annotations

import numpy as np
from scipy import stats

from rpil.cli.evaluate import sentences, values
from rpil.simulation.rollouts import Returns


def test_successes_in_words_and_numbers():
    played = Returns.of(np.full(20, 5.0), np.array([3, 0] * 6 + [0] * 8))
    wilson = stats.binomtest(6, 20).proportion_ci(method="wilson")
    printed = values(played)
    assert printed["success"] == [True, False] * 6 + [False] * 8
    assert (printed["mean"], printed["success_rate"], printed["median_steps_to_success"]) == (5, 6 / 20, 3)
    np.testing.assert_allclose(printed["success_ci95"], (wilson.low, wilson.high))
    assert list(sentences(played, "Climb")) == [
        "Mean return 5.0 (95 % interval 5.0 to 5.0) over 20 episodes of Climb.",
        f"Success in 6 of 20 episodes: 30 % (95 % interval {100 * wilson.low:.0f} to {100 * wilson.high:.0f} %), "
        "after a median of 3 steps.",
    ]
    never = Returns.of(np.zeros(2), np.zeros(2, dtype=int))
    assert "after" not in list(sentences(never, "Climb"))[1]
    unknown = Returns.of(np.zeros(2), None)
    assert list(values(unknown)) == ["mean", "ci95", "returns"]
    assert len(list(sentences(unknown, "Climb"))) == 1
