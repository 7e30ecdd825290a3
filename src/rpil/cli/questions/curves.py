"""What was recorded of demonstrations, as curves: each part of the action and each observation, over the steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np

from rpil.data.demonstrations import Block, Demonstrations
from rpil.data.errors import DataError
from rpil.data.text import printable
from rpil.formats.dataset import Dataset
from rpil.numerics.types import Array, Float
from rpil.results.judged import bin_means, bin_starts
from rpil.results.view import View, packed, significant

MAX_CURVES = 200
"""Columns that a page can draw: the parts of the action, and the first observations."""

N_SPREAD = 30
"""Demonstrations in which the spread of a column is measured, evenly spaced: all of many would take long to read."""

N_POINTS = 48
"""Points of a curve where one column of all demonstrations is drawn."""

CUT = 0.005
"""Share of the values at either end that are drawn at the edge, so that one spike does not flatten all others."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """The columns of demonstrations."""

    data: Demonstrations | Dataset

    @cached_property
    def columns(self) -> list[View]:
        """Of each column the name, whether it is of the action, the spread of its values, and its classes, if any."""
        data = self.data
        actions = data.action_names or [f"action {k}" for k in range(data.n_actions)] or ["action"]
        names = [*actions, *data.observation_names][:MAX_CURVES]
        some = data.select(np.unique(np.linspace(0, len(data) - 1, N_SPREAD).round().astype(int)))
        with np.errstate(all="ignore"):  # of the largest numbers it may be infinite, which JSON is not
            spread = [float(np.nan_to_num(self._values(some, k).std())) for k in range(len(names))]
        return [
            {"name": printable(name), "is_action": k < len(actions), "spread": significant(spread[k])}
            | {"classes": [printable(one) for one in data.classes.tolist()] if k < len(actions) else []}
            for k, name in enumerate(names)
        ]

    def curves(self, m: int) -> list[View]:
        """The columns of demonstration `m`, each packed by itself; of classes their numbers."""
        one, curves = self.data.select([m]), []
        for k, column in enumerate(self.columns):
            values = self._values(one, k)
            curves.append(
                packed({"value": values[bin_starts(len(values))] if column["classes"] else bin_means(values)})
            )
        return curves

    def column(self, k: int) -> View:
        """Column `k` of every demonstration, on one scale, by number as text; see `rpil.results.view.packed`."""
        if not 0 <= k < len(self.columns):
            raise DataError("There is no such column.")
        curves: list[Array] = []
        for block in chain.from_iterable(self.data.shards()):
            for own in np.split(self._values(block, k), block.offsets[1:-1]):
                curves.append(own[np.linspace(0, len(own) - 1, N_POINTS).astype(int)])
        low, high = np.nanquantile(curves, (CUT, 1 - CUT)).tolist()
        return packed({str(m): own for m, own in enumerate(curves)}, (low, high))

    def _values(self, some: Block | Demonstrations, k: int) -> Float[Array, " N"]:
        """Column `k` of some of the data: first come the parts of the action, then the observations."""
        n_parts = max(self.data.n_actions, 1)
        if k >= n_parts:
            return some.observations[:, k - n_parts].astype(float)
        actions = np.searchsorted(self.data.classes, some.actions) if self.data.is_discrete else some.actions
        return actions.reshape(len(actions), -1)[:, k].astype(float)
