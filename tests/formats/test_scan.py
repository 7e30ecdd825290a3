"""One pass over the rows: the same whatever the size of the tables, and tolerant of values that are missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from rpil.formats.columns import Columns
from rpil.formats.layout import Layout
from rpil.formats.places import Order, Places
from rpil.formats.rows import TableRows
from rpil.formats.scan import scan

COLUMNS = Columns("episode", ("action",), ("obs.moves", "obs.goal", "obs.never"), True, operator="who")


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
