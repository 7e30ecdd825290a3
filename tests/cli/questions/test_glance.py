"""Columns of all demonstrations as small curves."""

from __future__ import annotations

import numpy as np
import pytest

from rpil import Demonstrations, read
from rpil.cli.questions.glance import N_POINTS, column_curves, column_names
from rpil.data.errors import DataError


def test_columns_are_curves_on_one_scale(data):
    demonstrations = read(data, observations=["x", "v"])
    assert column_names(demonstrations) == ["action", "x", "v"]
    curves = column_curves(demonstrations, 2)
    assert [*curves] == ["from", "to", *map(str, range(24))]
    assert len(curves["23"]) == N_POINTS * 4 / 3, "base64 of bytes"
    for k in (-1, 3):
        with pytest.raises(DataError, match="There is no such column"):
            column_curves(demonstrations, k)


def test_actions_that_are_classes_are_drawn_by_their_order():
    episodes = [(np.zeros((n, 1)), np.array(["left", "right"])[np.arange(n) % 2]) for n in (1, 5)]
    demonstrations = Demonstrations.from_episodes(episodes)
    assert column_names(demonstrations) == ["action", "0"]
    curves = column_curves(demonstrations, 0)
    assert (curves["from"], curves["to"]) == (0, 1)
