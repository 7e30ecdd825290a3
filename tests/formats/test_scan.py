"""One pass over the rows: the same whatever the size of the tables, and tolerant of values that are missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from rpil.data.errors import DataError
from rpil.formats.columns import Columns
from rpil.formats.layout import Layout
from rpil.formats.places import Order, Places, find_places
from rpil.formats.rows import TableRows
from rpil.formats.scan import scan

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
def test_places_are_found_by_the_ids(batch, monkeypatch):
    monkeypatch.setattr("rpil.formats.rows.BATCH_ROWS", batch)
    rows = TableRows(pa.table(TABLE), "toy")
    places, same = find_places(rows, COLUMNS, "toy")
    assert (places.ids, places.offsets.tolist()) == (PLACES.ids, [0, 3, 4, 8])
    assert same is rows


def test_missing_values_are_counted_and_the_first_fault_is_kept(monkeypatch):
    one = found(2, monkeypatch, **{"action": [0, 1, None, 1, 1, None, 1, 0], "obs.moves": [np.nan, *range(7)]})
    assert one.statistics.missing == {"action": 2, "obs.moves": 1}
    assert one.actions.classes.tolist() == [0, 1]
    with pytest.raises(DataError, match="toy, demonstration 'a', row 3: column 'action' has no value"):
        raise one.actions.fault


def repeating(batch, monkeypatch, n_columns=("moves", "last", "still"), columns=COLUMNS, **changes):
    """Two demonstrations of 20 steps whose observation ``last`` is the action of the step before."""
    monkeypatch.setattr("rpil.formats.rows.BATCH_ROWS", batch)
    action = np.random.default_rng(0).normal(size=(40, 2))
    last = np.concatenate([np.zeros((1, 2)), action[:-1]])
    last[20] = 0.0
    values = {"moves": action + 1, "last": last, "still": np.zeros((40, 2))} | changes
    data = {"episode": np.repeat([0, 1], 20), "action": action.tolist()}
    table = pa.table(data | {f"obs.{name}": values[name].tolist() for name in n_columns})
    names = tuple(f"obs.{name}" for name in n_columns)
    columns = replace(columns, observations=names, operator=None)
    places = Places((0, 1), np.array([0, 20, 40]), Order())
    return scan(TableRows(table, "toy"), Layout.of(table, columns, {}), columns, "toy", places)


@pytest.mark.parametrize("batch", [1, 7, 20, 100])
def test_a_column_that_repeats_the_last_action_is_no_observation(batch, monkeypatch):
    found = repeating(batch, monkeypatch)
    assert found.last_actions == {"obs.last"}
    assert found.layout.observation_names == ("moves.0", "moves.1", "still.0", "still.1")
    assert not any("last" in name for name in found.statistics.ranges(found.layout.names))


def test_a_column_that_repeats_it_almost_or_that_is_all_there_is_stays(monkeypatch):
    last = np.zeros((40, 2))
    assert not repeating(100, monkeypatch, last=last).last_actions
    assert not repeating(100, monkeypatch, ["last"]).last_actions
    assert not repeating(100, monkeypatch, columns=replace(COLUMNS, observations_given=True)).last_actions
    whole = repeating(100, monkeypatch)
    values = np.random.default_rng(0).normal(size=(40, 2))
    almost = np.concatenate([np.zeros((1, 2)), values[:-1]])
    almost[20], almost[30] = 0.0, 9.0
    assert whole.last_actions
    assert not repeating(7, monkeypatch, last=almost).last_actions
