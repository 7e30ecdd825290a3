"""Columns become a frame of the library that was asked for, or of the first that is installed."""

from __future__ import annotations

import sys

import pyarrow as pa
import pytest

from problems import refused
from rpil.data import frames
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
    for missing, chosen in (((), "pandas"), (("pandas",), "polars"), (("pandas", "polars"), "pyarrow")):
        pytest.importorskip(chosen)
        monkeypatch.setattr(frames, "find_spec", lambda name, missing=missing: None if name in missing else object())
        assert type(data_frame(COLUMNS, None)).__module__.split(".")[0] == chosen


def test_what_is_unknown_or_not_installed_is_refused(monkeypatch):
    with refused(r"backend='dask' is unknown; choose one of 'pandas', 'polars'"):
        data_frame(COLUMNS, "dask")
    monkeypatch.setitem(sys.modules, "polars", None)
    with refused("backend='polars' is not installed"):
        data_frame(COLUMNS, "polars")
