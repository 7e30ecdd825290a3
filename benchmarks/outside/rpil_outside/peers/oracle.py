"""The truth: good demonstrations, and of them the good steps where these are known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..world import Made


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    return made.good.astype(float)


def weights(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    steps = np.repeat(made.good, made.demonstrations.lengths)
    return (steps if made.good_steps is None else made.good_steps).astype(float)
