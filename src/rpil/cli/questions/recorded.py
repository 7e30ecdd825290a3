"""What was recorded of demonstrations, to be drawn: each observation and each part of the action, over the steps."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rpil.cli.questions.glance import column_names
from rpil.data.arrays import PartClasses
from rpil.data.demonstrations import Demonstrations
from rpil.data.text import printable
from rpil.formats.dataset import Dataset
from rpil.numerics.types import Array, Float
from rpil.results.judged import bin_means, bin_starts
from rpil.results.view import View, packed, significant

MAX_CURVES = 200
"""Columns that a page can draw: the parts of the action, and the first observations."""

N_SPREAD = 30
"""Demonstrations in which the spread of a column is measured, evenly spaced: all of many would take long to read."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """The columns of demonstrations; there are none where nothing is known of the data."""

    demonstrations: Demonstrations | Dataset | None = None

    @cached_property
    def columns(self) -> list[View]:
        """Of each column the name, whether it is of the action, the spread of its values, and its classes, if any."""
        data = self.demonstrations
        if data is None:
            return []
        some = np.unique(np.linspace(0, len(data) - 1, N_SPREAD).round().astype(int))
        with np.errstate(all="ignore"):  # of the largest numbers it may be infinite, which JSON is not
            spread = np.nan_to_num(_values(data, data.select(some)).std(axis=0)).tolist()
        n_parts = len(spread) - data.n_observations
        no_classes: PartClasses = ((),) * n_parts
        classes = (tuple(data.classes.tolist()),) if data.is_discrete else data.part_classes or no_classes
        return [
            {"name": printable(name), "is_action": k < n_parts, "spread": significant(spread[k])}
            | {"classes": [printable(one) for one in classes[k]] if k < n_parts else []}
            for k, name in enumerate(column_names(data)[:MAX_CURVES])
        ]

    def curves(self, name: Hashable) -> list[View]:
        """The columns of the demonstration with this id, each packed by itself; of classes their numbers."""
        data = self.demonstrations
        if data is None:
            return []
        values = _values(data, data.select([data.ids.index(name)]))
        starts = bin_starts(len(values))
        return [
            packed({"value": values[starts, k] if column["classes"] else bin_means(values[:, k])})
            for k, column in enumerate(self.columns)
        ]


def _values(data: Demonstrations | Dataset, some: Demonstrations) -> Float[Array, "N C"]:
    """The numbers of the columns of some of the data: first the parts of the action, then the observations."""
    actions = np.searchsorted(data.classes, some.actions) if data.is_discrete else some.actions
    return np.concatenate([actions.reshape(len(actions), -1), some.observations], axis=1, dtype=float)
