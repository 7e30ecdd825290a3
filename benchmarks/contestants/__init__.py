"""Methods that rank demonstrations, ours among them: `CONTESTANTS[name](demonstrations, seed) -> score (M,)`.

Higher is better. None reads the truth. All but ours and the mutual information learn policies that are linear in the
raw observation. One that is not made for continuous actions raises a `DataError` that says so.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from contestants.ileed import ileed
from contestants.likelihood import cleanlab, pooled, trimmed
from rpil.data.demonstrations import Demonstrations
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL
from value.information import information
from worlds import Array

OURS = "rpil"


def ours(data: Demonstrations, seed: int) -> Array:
    """The default audit, without answers."""
    return np.asarray(RPIL(random_state=seed).fit(data).audit_.log_odds)


def rm_ent(data: Demonstrations, seed: int) -> Array:
    """Robust maximum entropy (eq. 2 of the paper): the half of the demonstrations that one policy explains best.

    The paper is told how many are good and ranks nothing; here it is half of them, and the score is the mean
    log-likelihood under the final policy.
    """
    return np.asarray(RMEnt(0.5, features="raw", random_state=seed).fit(data).log_likelihood_)


def length(data: Demonstrations, seed: int) -> Array:
    """The number of steps, long is good; for the opposite belief take one minus its AUROC."""
    return data.lengths.astype(float)


CONTESTANTS: dict[str, Callable[[Demonstrations, int], Array]] = {
    OURS: ours,
    "trimmed likelihood": trimmed,
    "likelihood": pooled,
    "RM-ENT": rm_ent,
    "mutual information": information,
    "ILEED": ileed,
    "cleanlab": cleanlab,
    "length": length,
}
