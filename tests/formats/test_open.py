"""`rpil.open` gives a recording that is asked for what the commands print."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import rpil
from recordings import changed, demonstrations, recording
from rpil.data.errors import DataError

EPISODES = recording()


def spiky():
    observations = EPISODES[3][0].copy()
    observations[40, 0] += 90
    return changed(EPISODES, 3, observations=observations)


def test_what_is_said_of_faults_is_used(tmp_path):
    rpil.write(tmp_path / "a.parquet", demonstrations(spiky()))
    opened = rpil.open(tmp_path / "a.parquet")
    assert repr(opened) == "\n".join(opened.describe().short())
    assert {(found.rule, found.id) for found in rpil.check(opened).findings} == {("spike", 3)}
    assert rpil.check(opened, expected={"spike": ["3"]}).n_expected == 1
    assert rpil.check(opened).not_checked["dropped frames"] == "the recording has no timestamps"


def test_missing_values_are_reported_and_not_learned_from(tmp_path):
    rows = [{"episode": m, "x": float(n), "action": n % 2} for m in range(9) for n in range(20)]
    frame = pd.DataFrame(rows)
    frame.loc[[3, 4], "x"] = np.nan
    opened = rpil.open(frame)
    with pytest.raises(DataError, match="demonstration 0"):
        rpil.RPIL().fit(opened)
    with pytest.raises(DataError, match="not opened from a file"):
        opened.keep([1], tmp_path / "a.csv")


def test_columns_are_chosen_as_by_read(tmp_path):
    (tmp_path / "texts").mkdir()
    rpil.write(tmp_path / "texts" / "a.csv", demonstrations(EPISODES))
    opened = rpil.open(tmp_path / "texts" / "a.csv", observations=["observation.0"])
    assert opened.demonstrations.n_observations == 1
    opened.keep([1], tmp_path / "b.csv")  # all columns
    assert rpil.read(tmp_path / "b.csv").n_observations == 3
    (tmp_path / "tables").mkdir()
    rpil.write(tmp_path / "tables" / "a.parquet", demonstrations(EPISODES))
    assert isinstance(rpil.open(tmp_path / "tables").demonstrations, rpil.Demonstrations)
    assert isinstance(rpil.open(tmp_path / "tables", memory="10kB").demonstrations, rpil.Dataset)
