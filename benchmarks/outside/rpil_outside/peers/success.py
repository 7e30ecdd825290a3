"""The recorded flag of success: those that ended well are kept, however they got there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from .common import NotMadeForIt

if TYPE_CHECKING:
    from ..world import Made


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    if made.success is None:
        raise NotMadeForIt("no success is recorded")
    return np.asarray(made.success, dtype=float)


def weights(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    return np.repeat(score(made, answers, seed), made.demonstrations.lengths)
