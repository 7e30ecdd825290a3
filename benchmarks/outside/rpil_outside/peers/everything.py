"""All demonstrations alike: what every other column is compared with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..world import Made


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    return np.zeros(len(made.demonstrations))


def weights(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    return np.ones(made.demonstrations.n_steps)
