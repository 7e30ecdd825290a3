"""Columns with strange names: the error guesses, in the words of Python and of the shell, and reads nothing by it."""

from __future__ import annotations

import re
import shlex

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

import rpil
from command_line import call, ok, refused
from rpil.data.errors import DataError
from rpil.formats.columns import ColumnOptions
from rpil.formats.guesses import RoleError, guess_options, quantity


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


def test_it_guesses_by_names_and_values():
    expected = {"id": "trip", "action": "steer,brake_pressure", "operator": "driver"}
    assert guess_options(drives(), ColumnOptions()) == expected
    renamed = drives().rename_columns({"driver": "hand"})
    assert guess_options(renamed, ColumnOptions())["operator"] == "hand"  # text, few values, one for each trip
    shuffled = drives().take(np.random.default_rng(0).permutation(300))
    assert guess_options(shuffled, ColumnOptions()) == {}  # no column comes in runs


def test_what_is_given_is_no_guess():
    given = ColumnOptions(id="day", action=("lane",), exclude=("weather", "steer"))
    assert guess_options(drives(), given) == {
        "id": "day", "action": "lane", "operator": "driver", "exclude": "weather,steer",
    }  # fmt: skip
    assert guess_options(drives(), ColumnOptions(id="nothing")) == {}


def test_nothing_is_guessed_without_an_id_and_an_action():
    assert guess_options(drives().drop_columns(["steer", "brake_pressure"]), ColumnOptions()) == {}
    assert guess_options(drives().select(["lane", "steer", "weather"]), ColumnOptions()) == {}
    assert guess_options(drives().slice(0, 0), ColumnOptions()) == {}
    assert guess_options(None, ColumnOptions()) == {}


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_the_printed_command_runs(suffix, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    writer = pa.csv.write_csv if suffix == "csv" else pq.write_table
    writer(drives(), f"my drive.{suffix}")
    with pytest.raises(RoleError, match=r"perhaps id='trip', action='steer,brake_pressure', operator='driver'\.$"):
        rpil.read(f"my drive.{suffix}")
    for command in ("info", "audit"):
        words = refused("no column says which demonstration", command, f"my drive.{suffix}", "--exclude", "lane")
        words = shlex.split(words.rstrip(".\n").partition("perhaps: ")[2])
        assert words == ["rpil", "audit", f"my drive.{suffix}", "--id", "trip", "--action", "steer,brake_pressure",
                         "--exclude", "lane", "--operator", "driver"]  # fmt: skip
    printed = ok("info", *words[2:]).stdout
    assert f"Next: {shlex.join(words)}\n" in printed
    assert "12 demonstrations" in printed


def test_an_operator_that_was_found_is_in_the_next_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pa.csv.write_csv(drives(), "drive.csv")
    printed = ok("info", "drive.csv", "--id", "trip", "--action", "steer").stdout
    assert printed.endswith("Next: rpil audit drive.csv --id trip --action steer --operator driver\n")


@pytest.mark.parametrize(
    ("text", "said"), [("9.8 m/s", "9.8 m/s"), ("-3,5 %", "-3,5 %"), ("2024-01-02", ""), ("10:15", ""), ("left", "")]
)
def test_a_number_with_a_unit_is_a_quantity(text, said):
    assert quantity(pa.table({"x": [text]}), "x") == said


def test_a_numeric_column_that_is_lost_is_named(tmp_path):
    table = drives(speed=[f"{n / 7:.2f} m/s" for n in range(300)])
    pa.csv.write_csv(table, tmp_path / "drive.csv")
    ignored = rpil.open(tmp_path / "drive.csv", id="trip", action="steer").description.ignored
    assert ignored["speed"] == "text, as '0.00 m/s'; to observe it, write its numbers alone"
    assert ignored["weather"] == "text"


def test_one_step_ids_are_doubted(tmp_path):
    pa.csv.write_csv(drives().append_column("run_id", [np.arange(300)]), tmp_path / "drive.csv")
    notes = rpil.open(tmp_path / "drive.csv", id="run_id", action="steer").description.notes
    assert notes[0] == "Each demonstration has one step: is run_id the right column of the demonstration?"
    assert not any(
        "one step" in note for note in rpil.open(tmp_path / "drive.csv", id="trip", action="steer").description.notes
    )


@pytest.mark.parametrize(
    ("action", "observations", "said"),
    [
        ("steer", "lane,steer", "'steer' is part of the action already; take it out of observations="),
        ("steer", "*", "'trip' is the id already; take it out of observations="),
        ("steer,trip", (), "'trip' is the id already; take it out of action="),
    ],
)
def test_a_column_of_two_roles_is_refused(action, observations, said, tmp_path):
    pa.csv.write_csv(drives(), tmp_path / "drive.csv")
    with pytest.raises(DataError, match=re.escape(said)):
        rpil.open(tmp_path / "drive.csv", id="trip", action=action, observations=observations)


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["--action", "steer", "lane"], "write --action steer,lane"),
        (["--id", "trip", "--exclude", "a b", "lane", "day"], "write --exclude 'a b,lane,day'"),
        (["--json", "a b.json"], "write --json > 'a b.json'"),
        (["--id", "trip", "lane"], None),
    ],
)
def test_columns_without_commas_are_joined_in_the_answer(words, meant, tmp_path):
    (tmp_path / "x.csv").write_text("a\n1\n")
    said = call("audit", tmp_path / "x.csv", *words).stderr
    assert "unexpected extra argument" in said
    assert (re.search("write --", said) is None) if meant is None else meant in said
