"""Isolation forest (Liu, Ting and Zhou, 2008) of scikit-learn on simple facts of each demonstration, not its length."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from sklearn.ensemble import IsolationForest

from .common import mean_of, scaled, states, targets

if TYPE_CHECKING:
    from rpil import Demonstrations

    from ..world import Made


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    facts = summaries(made.demonstrations)
    return np.asarray(IsolationForest(random_state=seed).fit(facts).score_samples(facts))


def summaries(data: Demonstrations) -> np.ndarray:
    """Simple facts of each demonstration (M, F): mean, deviation, first, last and mean change of every column."""
    rows = np.column_stack([states(data), targets(data)])
    change = np.abs(np.diff(rows, axis=0, append=rows[-1:]))
    change[data.offsets[1:] - 1] = 0.0
    mean = mean_of(data, rows)
    spread = np.sqrt(np.maximum(mean_of(data, rows**2) - mean**2, 0.0))
    first, last = rows[data.offsets[:-1]], rows[data.offsets[1:] - 1]
    return scaled(np.column_stack([mean, spread, first, last, mean_of(data, change)]))
