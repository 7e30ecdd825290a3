"""Methods that rank demonstrations, ours among them: `CONTESTANTS[name](demonstrations, seed) -> score (M,)`.

Higher is better. None reads the truth. All but ours and the mutual information learn policies that are linear in the
raw observation. One that is not made for continuous actions raises a `DataError` that says so.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import rpil
from contestants.ileed import ileed
from contestants.likelihood import cleanlab, pooled, trimmed
from rivals.short_judge import Judge
from rpil.data.demonstrations import Demonstrations
from rpil.estimators.rment import RMEnt
from value.information import information
from worlds import Array

OURS = "rpil"


def ours(data: Demonstrations, seed: int) -> Array:
    """The default audit, without answers."""
    return np.asarray(rpil.audit(data, random_state=seed).log_odds)


def rm_ent(data: Demonstrations, seed: int) -> Array:
    """Robust maximum entropy (eq. 2 of the paper): the half of the demonstrations that one policy explains best.

    The paper is told how many are good and ranks nothing; here it is half of them, and the score is the mean
    log-likelihood under the final policy.
    """
    return np.asarray(RMEnt(0.5, features="raw", random_state=seed).fit(data).log_likelihood_)


def length(data: Demonstrations, seed: int) -> Array:
    """The number of steps, long is good; for the opposite belief take one minus its AUROC."""
    return data.lengths.astype(float)


def short_judge(data: Demonstrations, seed: int) -> Array:
    """The ranking of the judge in a hundred lines (`rivals/short_judge.py`)."""
    actions = np.unique(data.actions, return_inverse=True)[1] if data.is_discrete else data.actions.astype(float)
    of_step = np.repeat(np.arange(len(data)), data.lengths)
    return np.asarray(Judge(data.observations, actions, of_step, seed).rank)


CONTESTANTS: dict[str, Callable[[Demonstrations, int], Array]] = {
    OURS: ours,
    "trimmed likelihood": trimmed,
    "likelihood": pooled,
    "short judge": short_judge,
    "RM-ENT": rm_ent,
    "mutual information": information,
    "ILEED": ileed,
    "cleanlab": cleanlab,
    "length": length,
}
