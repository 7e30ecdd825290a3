"""What to do after an audit, and which labels would tell most about the other demonstrations.

A label settles every pair that its demonstration is one of: in the right order, or in the wrong one. So those labels
are asked for that settle most of the pairs which may be wrong. The order of an audit deserves more trust than its
probabilities, which may be too sure, and rest on a share of experts that is not known. Should the order mean anything,
and the share be any, the demonstration of rank r (0 for the least trusted, 1 for the most) is an expert's with
probability r. Then of all demonstrations the share

    r * int_r^1 (1 - s) ds + (1 - r) * int_0^r s ds = r (1 - r) / 2

makes a pair with it that is in the wrong order: those in the middle are asked about. They are not those of which the
audit is most uncertain: where it trusts too many these are at the bottom, where most are as bad as it says.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rpil.numerics.types import Array

NEXT = {
    "told apart": "Look at the worst steps of a few adversaries, and label a demonstration whose verdict is wrong.",
    "cannot be known": "Label one demonstration of either group, or choose minority=trust if both groups are good.",
    "nobody stands out": "Look at the lowest ranked demonstrations, and label those that you can judge.",
    "nothing could be learned": "Check that the observations hold what the actions depend on, or give more "
    "demonstrations.",
}
"""What to do next, by finding."""


def middle(log_odds: Array) -> Array:
    """Indices (M,), those in the middle of the order first, its ends last."""
    order = np.argsort(log_odds, kind="stable")
    away = np.abs(2 * np.arange(len(order)) - (len(order) - 1))
    found: Array = order[np.argsort(away, kind="stable")]
    return found


def suggest(log_odds: Array, first: Sequence[int], labelled: Sequence[int], k: int) -> list[int]:
    """Up to `k` demonstrations to label, the most telling first.

    Parameters
    ----------
    log_odds : (M,) array
        Of which the order counts.
    first : sequence of int
        To be asked for before all others.
    labelled : sequence of int
        Not to be asked for again.
    k : int
    """
    free = np.setdiff1d(np.arange(len(log_odds)), [*labelled, *first])
    return [*(m for m in first if m not in labelled), *free[middle(log_odds[free])].tolist()][:k]
