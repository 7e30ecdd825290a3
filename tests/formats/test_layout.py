"""Which arrays columns make: names, widths, types."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from rpil.data.errors import DataError
from rpil.formats.columns import Columns
from rpil.formats.layout import Layout

SINGLE = pa.list_(pa.float32())
STATE = pa.array([[1, 2], [3, 4]], SINGLE)


def layout(action, *observations, joints=None):
    names = tuple(f"obs.{k}" for k in range(len(observations)))
    table = pa.table({"action": action, **dict(zip(names, observations, strict=True))})
    return table, Layout.of(table, Columns("episode", ("action",), names, True), joints or {})


@pytest.mark.parametrize(
    ("action", "dtype", "n_parts"),
    [
        (pa.array([0, 1]), np.int64, 0),
        (pa.array(["left", "right"]), np.str_, 0),
        (pa.array([0.5, 1], pa.float32()), np.float32, 0),  # all steps decide whether these are classes
        (pa.array([[0], [1]]), np.int64, 0),
        (pa.array([[0.5], [1.0]]), np.float64, 1),
        (STATE, np.float32, 2),
    ],
)
def test_actions_by_type(action, dtype, n_parts):
    found = layout(action, STATE)[1]
    assert (found.action, found.n_parts) == (np.dtype(dtype), n_parts)


def test_a_list_has_a_name_for_each_number_and_missing_first_lists_are_passed_over():
    missing = pa.array([None, [5, 6]], SINGLE)
    found = layout(STATE, missing, pa.array([1.0, 2.0]), joints={"obs.0": ["a", "b"]})[1]
    assert found.names == {"obs.0": ("0.a", "0.b"), "obs.1": ("1",), "action": ("action.0", "action.1")}
    assert found.observation == np.float64 != layout(STATE, STATE)[1].observation


def test_lists_of_another_length_and_texts_are_named():
    found = layout(STATE, STATE)[1]
    longer, _ = layout(STATE, pa.array([[1, 2, 3], [4, 5, 6]], SINGLE))
    words, _ = layout(STATE, pa.array(["1", "fast"]))
    for table, message in ((longer, "holds 3 numbers, not 2"), (words, "row 1: column 'obs.0' holds text .'fast'")):
        with pytest.raises(DataError, match=message):
            found.fill(*found.empty(2), table, lambda row: f"row {row}")
