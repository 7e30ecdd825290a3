"""Columns become a frame of the library that was asked for, or of the first that is installed."""

from __future__ import annotations

import sys

import pyarrow as pa
import pytest

from problems import refused
from rpil.data.frames import data_frame

COLUMNS = {"id": ["a", "b"], "score": (1.5, -2.0)}


@pytest.mark.parametrize("backend", ["pandas", "polars", "pyarrow"])
def test_every_backend_holds_the_columns(backend):
    kind = pytest.importorskip(backend)
    frame = data_frame(COLUMNS, backend)
    assert isinstance(frame, kind.Table if backend == "pyarrow" else kind.DataFrame)
    table = pa.table(frame)
    assert {name: table[name].to_pylist() for name in table.column_names} == {"id": ["a", "b"], "score": [1.5, -2.0]}


def test_by_default_the_first_that_is_installed(monkeypatch):
    for missing, chosen in ((None, "pandas"), ("pandas", "polars"), ("polars", "pyarrow")):
        pytest.importorskip(chosen)
        if missing:
            monkeypatch.setitem(sys.modules, missing, None)
        assert type(data_frame(COLUMNS, None)).__module__.split(".")[0] == chosen
    for backend in ("polars", "dask"):
        with refused(rf"backend='{backend}' is unknown or not installed; choose one of 'pandas', 'polars'"):
            data_frame(COLUMNS, backend)
