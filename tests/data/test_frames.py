"""Columns become a frame of pandas where it is installed."""

from __future__ import annotations

import sys

import pyarrow as pa
import pytest

from rpil.data.text import data_frame

COLUMNS = {"id": ["a", "b"], "score": (1.5, -2.0)}


@pytest.mark.parametrize("missing", [False, True])
def test_a_frame_holds_the_columns(missing, monkeypatch):
    pandas = pytest.importorskip("pandas")
    if missing:
        monkeypatch.setitem(sys.modules, "pandas", None)
    frame = data_frame(COLUMNS)
    assert isinstance(frame, pa.Table if missing else pandas.DataFrame)
    table = pa.table(frame)
    assert {name: table[name].to_pylist() for name in table.column_names} == {"id": ["a", "b"], "score": [1.5, -2.0]}
