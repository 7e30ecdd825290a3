"""All demonstrations at a glance: one column of each as a small curve, for data without films."""

from __future__ import annotations

from itertools import chain

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.formats.dataset import Dataset
from rpil.results.view import View, packed

N_POINTS = 48
"""Points of a curve."""

CUT = 0.005
"""Share of the values at either end that are drawn at the edge, so that one spike does not flatten all others."""


def column_names(data: Demonstrations | Dataset) -> list[str]:
    """The columns of the actions, then those of the observations."""
    actions = data.action_names or [f"action {k}" for k in range(data.n_actions)] or ["action"]
    return [*actions, *data.observation_names]


def column_curves(data: Demonstrations | Dataset, k: int) -> View:
    """Column `k` of every demonstration, on one scale, by number as text; see `rpil.results.view.packed`."""
    n_actions, curves = len(column_names(data)) - data.n_observations, []
    if not 0 <= k < n_actions + data.n_observations:
        raise DataError("There is no such column.")
    for block in chain.from_iterable(data.shards()):
        actions = block.actions.reshape(len(block.actions), -1)
        column = actions[:, k] if k < n_actions else block.observations[:, k - n_actions]
        values = np.searchsorted(data.classes, column) if column.dtype.kind not in "iufb" else column
        for own in np.split(values.astype(float), block.offsets[1:-1]):
            curves.append(own[np.linspace(0, len(own) - 1, N_POINTS).astype(int)])
    low, high = np.nanquantile(curves, (CUT, 1 - CUT)).tolist()
    return packed({str(m): own for m, own in enumerate(curves)}, (low, high))
