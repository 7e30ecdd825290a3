"""One pass over the rows: columns that repeat the last action are found, whatever the size of the tables."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

import rpil


def described(monkeypatch, batch=100, names=("moves", "last", "still"), last=None, **options):
    """Two demonstrations of 20 steps whose observation ``last`` is the action of the step before."""
    monkeypatch.setattr("rpil.formats.rows.BATCH_ROWS", batch)
    action = np.random.default_rng(0).normal(size=(40, 2))
    before = np.concatenate([np.zeros((1, 2)), action[:-1]])
    before[20] = 0.0
    if last:
        before = last(before)
    values = {"moves": action + 1, "last": before, "still": np.zeros((40, 2))}
    columns = {"episode": np.repeat([0, 1], 20), "action": action.tolist()}
    table = pa.table(columns | {f"obs.{name}": values[name].tolist() for name in names})
    return rpil.open(table, **options).describe()


@pytest.mark.parametrize("batch", [1, 7, 20, 100])
def test_a_column_that_repeats_the_last_action_is_no_observation(batch, monkeypatch):
    said = described(monkeypatch, batch)
    assert said.observations == ("moves.0", "moves.1", "still.0", "still.1")
    assert said.ignored["obs.last"] == "it repeats the last action"
    assert not any("last" in name for name in said.ranges)


@pytest.mark.parametrize(
    "options",
    [
        {"last": lambda before: 0 * before},
        {"last": lambda before: before + 9 * (np.arange(40) == 30)[:, None], "batch": 7},
        {"names": ["last"]},
        {"observations": "obs.last"},
    ],
)
def test_a_column_that_repeats_it_almost_or_that_is_all_there_is_stays(options, monkeypatch):
    assert "last.0" in described(monkeypatch, **options).observations
