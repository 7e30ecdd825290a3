"""Columns of what was recorded, as a page draws them; tests of videos are in test_material_videos.py."""

import base64

import numpy as np
import pytest

from rpil import read
from rpil.cli.questions.session import N_POINTS, Recorded
from rpil.data.errors import DataError


def values(curve):
    """The numbers that a packed curve stands for."""
    codes = np.frombuffer(base64.b64decode(curve["value"]), np.uint8)
    return curve["from"] + (curve["to"] - curve["from"]) * codes / 254


def test_parts_of_the_action_come_first_and_then_the_observations(data):
    demonstrations = read(data, observations=["x", "v"])
    recorded = Recorded(demonstrations)
    kinds = [(one["name"], one["is_action"]) for one in recorded.columns]
    assert kinds == [("action", True), ("x", False), ("v", False)]
    spread = demonstrations.observations.std(axis=0)
    assert [one["spread"] for one in recorded.columns[1:]] == pytest.approx(spread, rel=1e-5)
    action, x, _ = recorded.curves(3)
    own = slice(*demonstrations.offsets[3:5])
    for curve, true in ((action, demonstrations.actions[own, 0]), (x, demonstrations.observations[own, 0])):
        np.testing.assert_allclose(values(curve), true, atol=np.ptp(true) / 254)


def test_a_column_of_all_is_drawn_on_one_scale(data):
    demonstrations = read(data, observations=["x", "v"])
    recorded = Recorded(demonstrations)
    curves = recorded.column(2)
    shown = np.linspace(0, 39, N_POINTS).astype(int)
    ends = np.quantile(demonstrations.observations[:, 1].reshape(24, 40)[:, shown], (0.005, 0.995))
    assert (curves["from"], curves["to"]) == pytest.approx(ends, rel=1e-5), "a spike flattens no other"
    assert [*curves] == ["from", "to", *map(str, range(24))]
    assert len(curves["23"]) == N_POINTS * 4 / 3, "base64 of bytes"
    for k in (-1, 3):
        with pytest.raises(DataError, match="There is no such column"):
            recorded.column(k)
