"""Columns with strange names: the error lists them, and what is named twice, or looks wrong, is said."""

from __future__ import annotations

import re

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest

import rpil
from command_line import ok
from rpil.data.errors import DataError


def drives(n=12, steps=25, **changes):
    """Trips of two drivers, each on one of three days."""
    rng = np.random.default_rng(0)
    trip = np.repeat(np.arange(n), steps)
    columns = {
        "day": trip // 5,
        "trip": [f"t{m}" for m in trip],
        "driver": [("cem", "bob")[m % 2] for m in trip],
        "weather": [("dry", "wet")[int(rng.integers(2))] for _ in trip],
        "lane": rng.normal(size=n * steps),
        "steer": rng.normal(size=n * steps),
        "brake_pressure": rng.normal(size=n * steps),
    }
    return pa.table(columns | changes)


@pytest.mark.parametrize(
    ("action", "observations", "said"),
    [
        ("steer", "lane,steer", "'steer' is part of the action already; take it out of observations="),
        ("steer", "*", "'trip' is the id already; take it out of observations="),
    ],
)
def test_a_column_of_two_roles_is_refused(action, observations, said, tmp_path):
    pa.csv.write_csv(drives(), tmp_path / "drive.csv")
    with pytest.raises(DataError, match=re.escape(said)):
        rpil.open(tmp_path / "drive.csv", id="trip", action=action, observations=observations)


def test_an_operator_that_was_found_is_in_the_next_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pa.csv.write_csv(drives(), "drive.csv")
    printed = ok("info", "drive.csv", "--id", "trip", "--action", "steer").stdout
    assert printed.endswith("Next: rpil audit drive.csv --id trip --action steer --operator driver\n")
