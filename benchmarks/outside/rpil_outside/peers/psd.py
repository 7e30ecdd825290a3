"""PSD: the power spectral density of a trajectory, of which good ones have little (Sojib and Begum, arXiv 2605.01544).

Only the abstract was at hand, so this is the plainest reading: the periodogram of every scaled state column about its
mean, summed over frequencies and columns. As it is not divided by the number of steps, long demonstrations have more.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import periodogram

from .common import states

if TYPE_CHECKING:
    from ..world import Made


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    rows = states(made.demonstrations)
    return np.array(
        [-periodogram(rows[a:b], axis=0)[1].sum() for a, b in pairwise(made.demonstrations.offsets.tolist())]
    )
