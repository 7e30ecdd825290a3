"""Which demonstrations to label, and what to do after an audit.

A label settles every pair of demonstrations that contains the labelled one: the pair is in the right order or in the
wrong one. So the labels to ask for are those that settle the most pairs in the wrong order. The order of an audit is
more reliable than its probabilities, which may be overconfident and depend on the unknown share of good ones. Suppose
that nothing is known of this share, and that the order is informative: then the demonstration of rank r (0 for the
least trusted, 1 for the most) is good with probability r, and the share of all demonstrations that form a pair
in the wrong order with it is

    r * int_r^1 (1 - s) ds + (1 - r) * int_0^r s ds = r (1 - r) / 2.

This is largest in the middle of the ranking.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rpil.numerics.types import Array, Float, Int

NEXT_STEPS = {
    "some are unlike": "Look at the worst steps of a few that are called unlike, and label those that you can judge.",
    "answered": "Look at the worst steps of a few that are called bad, and label a demonstration whose word is wrong.",
    "mixture": "Look at the worst steps of a few adversaries, and label a demonstration whose word is wrong.",
    "two groups": "Label one demonstration of either group, or choose minority=trust if both groups are good.",
    "in doubt": "Look at the lowest ranked demonstrations, and label those that you can judge.",
    "nobody stands out": "Look at the lowest ranked demonstrations, and label those that you can judge.",
    "nothing could be learned": "Check that the observations contain what the actions depend on, or give more "
    "demonstrations.",
}
"""What to do next, by finding."""


def middle_first(log_odds: Float[Array, " M"]) -> Int[Array, " M"]:
    """Indices of the demonstrations by their distance from the middle of the ranking, the nearest first."""
    order = np.argsort(log_odds, kind="stable")
    distance = np.abs(2 * np.arange(len(order)) - (len(order) - 1))
    return np.asarray(order[np.argsort(distance, kind="stable")])


def choose_labels(log_odds: Float[Array, " M"], first: Sequence[int], labelled: Sequence[int], k: int) -> list[int]:
    """Indices of up to `k` demonstrations to label, the most informative first.

    Those in `first` come before all others; those in `labelled` have a label already.
    """
    others = np.setdiff1d(np.arange(len(log_odds)), [*labelled, *first])
    return [*(m for m in first if m not in labelled), *others[middle_first(log_odds[others])].tolist()][:k]
