"""Columns as a file of each kind."""

from __future__ import annotations

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from rpil.data.errors import DataError
from rpil.formats import EXTENSIONS, write_columns

COLUMNS = {"id": ["a", "b"], "value": [1.5, np.inf]}


def test_every_kind_holds_the_columns(tmp_path):
    for extension in EXTENSIONS:
        write_columns(tmp_path / f"a{extension}", COLUMNS, "columns", {"run": "one"})
    assert (tmp_path / "a.csv").read_text().splitlines()[:2] == ['"id","value"', '"a",1.5']
    table = pq.read_table(tmp_path / "a.parquet")
    assert table.to_pydict() == COLUMNS
    assert table.schema.metadata[b"run"] == b"one"
    assert json.loads((tmp_path / "a.json").read_text()) == [{"id": "a", "value": 1.5}, {"id": "b", "value": None}]
    with pytest.raises(DataError, match=r"columns"):
        write_columns(tmp_path / "a.txt", COLUMNS, "columns")
