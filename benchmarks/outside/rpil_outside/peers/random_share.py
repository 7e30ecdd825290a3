"""A random order, of which the first 60 % are kept: what it costs to have fewer demonstrations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..world import Made


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    return np.random.default_rng([seed, 60]).permutation(len(made.demonstrations)).astype(float)
