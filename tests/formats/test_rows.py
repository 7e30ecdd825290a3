"""Rows of a table in memory, in another order than theirs."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from rpil.formats.rows import TableRows, shifted

TABLE = pa.table({"x": [10, 11, 12, 13], "y": list("abcd")})
MOVED = TableRows(TABLE, "toy.csv", np.array([2, 0, 3, 1]), {"one.csv": 3, "two.csv": 1})


def test_rows_come_in_their_place():
    ((row, table, at),) = MOVED.tables(1, 3, ["x"], lambda row: f", demonstration {row}")
    assert (row, table.column_names, table["x"].to_pylist()) == (1, ["x"], [10, 13])
    assert at(1) == shifted(at, 1)(0) == "toy.csv, demonstration 2, row 4"
    assert MOVED.numbers(slice(0, 2))["row"].to_pylist() == [3, 1]
    assert TableRows(TABLE, "toy.csv").numbers(slice(0, 2)) is None


def test_rows_know_their_files():
    assert MOVED.files(np.array([0, 2, 3])) == ["one.csv", "two.csv", "one.csv"]
    assert TableRows(TABLE, "toy.csv").files(np.array([0])) == []


def test_large_tables_come_in_several(monkeypatch):
    monkeypatch.setattr("rpil.formats.rows.BATCH_ROWS", 3)
    tables = [(row, table["y"].to_pylist()) for row, table, _ in TableRows(TABLE, "toy").tables(0, 4, ["y"])]
    assert tables == [(0, ["a", "b", "c"]), (3, ["d"])]
