"""SAL of RINSE: the spectral arc length of the speed, of which smooth motion has little (arXiv 2604.23000).

As Balasubramanian et al. (2015) define it: minus the length of the curve of the normalised amplitude spectrum up to the
last frequency with an amplitude of .05. Adapted: the speed is the change of the scaled state from step to step, because
nothing names an end effector, and frequencies are parts of the highest.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from .common import states

if TYPE_CHECKING:
    from ..world import Made

PADDING, LEAST_AMPLITUDE = 4, 0.05


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    rows = states(made.demonstrations)
    return np.array([-arc_length(rows[a:b]) for a, b in pairwise(made.demonstrations.offsets.tolist())])


def arc_length(rows: np.ndarray) -> float:
    """That of one demonstration; 0 where it has less than three steps or never moves."""
    speed = np.linalg.norm(np.diff(rows, axis=0), axis=1)
    if len(speed) < 2 or not speed.any():
        return 0.0
    n = 2 ** (int(np.ceil(np.log2(len(speed)))) + PADDING)
    amplitude = np.abs(np.fft.rfft(speed, n))
    amplitude /= amplitude.max()
    amplitude = amplitude[: np.flatnonzero(amplitude >= LEAST_AMPLITUDE)[-1] + 1]
    step = 1 / max(len(amplitude) - 1, 1)
    return float(np.hypot(step, np.diff(amplitude)).sum())
