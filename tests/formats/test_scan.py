"""One pass over the rows: the same whatever the size of the tables, and tolerant of values that are missing."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from rpil.data.errors import DataError
from rpil.formats.columns import Columns
from rpil.formats.layout import Layout
from rpil.formats.order import Order
from rpil.formats.rows import TableRows
from rpil.formats.scan import Places, scan

PLACES = Places(("a", "b", "c"), np.array([0, 3, 4, 8]), Order())
TABLE = {
    "episode": list("aaabcccc"),
    "action": [0, 1, 0, 1, 1, 0, 1, 0],
    "obs.moves": np.arange(8.0),
    "obs.goal": [5.0, 5, 5, 6, 7, 7, 7, 7],  # constant within each demonstration
    "obs.never": np.ones(8),
    "who": ["Ann", "Ann", "Ann", None, "Bob", "Bob", "Bob", "Bob"],
}
COLUMNS = Columns("episode", ("action",), ("obs.moves", "obs.goal", "obs.never"), True, operator="who")


def found(batch, monkeypatch, places=PLACES, **changes):
    monkeypatch.setattr("rpil.formats.rows.BATCH_ROWS", batch)
    table = pa.table(TABLE | changes)
    return scan(TableRows(table, "toy"), Layout.of(table, COLUMNS, {}), COLUMNS, "toy", places)


@pytest.mark.parametrize("batch", [1, 2, 3, 5, 100])
def test_all_sizes_of_tables_give_the_same(batch, monkeypatch):
    one = found(batch, monkeypatch)
    assert one.statistics.constant(one.layout.names) == ["goal"]
    assert one.statistics.ranges(one.layout.names)["moves"] == (0, 7)
    assert (one.actions.kind, one.actions.classes.tolist()) == ("discrete", [0, 1])
    assert one.operators == [("a", "Ann"), ("b", None), ("c", "Bob")]


@pytest.mark.parametrize("batch", [1, 3, 100])
def test_places_are_read_where_they_are_not_known(batch, monkeypatch):
    places = found(batch, monkeypatch, None).places
    assert (places.ids, places.offsets.tolist()) == (PLACES.ids, [0, 3, 4, 8])


def test_missing_values_are_counted_and_the_first_fault_is_kept(monkeypatch):
    one = found(2, monkeypatch, **{"action": [0, 1, None, 1, 1, None, 1, 0], "obs.moves": [np.nan, *range(7)]})
    assert one.statistics.missing == {"action": 2, "obs.moves": 1}
    assert one.actions.classes.tolist() == [0, 1]
    with pytest.raises(DataError, match="toy, demonstration 'a', row 3: column 'action' has no value"):
        raise one.actions.fault
