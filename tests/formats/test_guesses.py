"""Where no name says the demonstration or the action, three commands guess; whatever acts on the data asks instead."""

from __future__ import annotations

import shlex

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

import rpil
from command_line import call, ok, refused
from rpil.data.errors import DataError
from rpil.formats.columns import guess_actions, guess_id

STEPS = 25


def drives(n=12, **changes):
    """Trips, each on one of three days, and the seconds of each."""
    rng = np.random.default_rng(0)
    trip, lane = np.repeat(np.arange(n), STEPS), rng.normal(size=n * STEPS)
    columns = {
        "clock": np.tile(np.arange(STEPS) / 20, n),
        "day": trip // 5,
        "trip": [f"t{m}" for m in trip],
        "weather": [("dry", "wet")[int(rng.integers(2))] for _ in trip],
        "lane": lane,
        "steer": -0.3 * lane + rng.normal(size=n * STEPS) / 10,
        "brake_pressure": rng.normal(size=n * STEPS),
    }
    return pa.table(columns | changes)


@pytest.fixture(autouse=True)
def current_folder(tmp_path, monkeypatch):
    """A current folder for each test, as refused() reads all of its files."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def drive():
    pa.csv.write_csv(drives(), "my drive.csv")
    return "my drive.csv"


def test_an_id_comes_in_runs_and_has_most_values():
    names = drives().column_names
    assert guess_id(drives(), names) == "trip"
    assert guess_id(drives(), ["day", "lane", "weather"]) == "day"
    assert guess_id(drives().take(np.random.default_rng(0).permutation(300)), names) is None
    assert guess_id(drives(t=np.arange(300) // 20), ["t"]) is None  # whole seconds
    assert guess_id(drives(on=np.arange(300) < 100), ["on"]) is None
    assert guess_id(drives(row=np.arange(300)), ["row"]) is None
    assert guess_id(drives(operator=np.arange(300) // 50), ["operator"]) is None  # who gives many demonstrations
    assert guess_id(drives(driver=np.arange(300) // 50), ["driver"]) == "driver"
    assert guess_id(drives(lap=pa.array([None, *range(299)])), ["lap"]) is None
    assert guess_id(None, names) is guess_id(drives().slice(0, 0), names) is None


def test_an_action_is_called_as_what_people_steer_with():
    assert guess_actions(["lane", "Steering Angle", "throttle", "keyboard", "user/angle"]) == [
        "Steering Angle",
        "throttle",
        "user/angle",
    ]
    assert guess_actions(["a,brake", "observation.last_throttle"]) == []
    sticks = ["stick", "stick_x", "sticky", "left_stick_y", "stick2", "insulin_bolus"]
    assert guess_actions([*sticks, "sticker", "sort_order"]) == sticks
    assert guess_actions(["throttle"]) == ["throttle"]


def test_a_decision_is_an_action_where_there_is_no_other_and_it_does_not_count_the_rows():
    head = pa.table({"order": np.tile(np.arange(25), 4), "orders": [3, 1, 4, 1] * 25, "choice": ["left", "right"] * 50})
    assert guess_actions(["order"], head=head) == []
    assert guess_actions(["order", "orders"], head=head) == ["orders"]
    assert guess_actions(["order"], ["choice", "key"], head) == ["choice"]
    assert guess_actions(["order", "stick_x"], ["choice"], head) == ["stick_x"]


def test_pedals_alone_are_no_action_because_the_wheel_may_have_a_name_of_another_language(tmp_path):
    pa.csv.write_csv(drives().rename_columns({"steer": "Lenkwinkel", "brake_pressure": "Pedal"}), tmp_path / "d.csv")
    said = "no column holds the action: name it action, or name the columns with --action .*'Lenkwinkel', 'Pedal'"
    refused(said, "info", tmp_path / "d.csv")
    with pytest.raises(DataError, match=r"no column holds the action: .* with action= "):
        rpil.audit(tmp_path / "d.csv")


@pytest.mark.parametrize("command", ["info", "audit", "check"])
def test_three_commands_go_on_with_their_guess_and_print_it(command, drive):
    done = ok(command, drive)
    said = "Guess: demonstrations by trip, action steer, brake_pressure; to change it, give --id and --action."
    assert done.stderr.splitlines().count(said) == 1
    assert "12 demonstrations" in done.stdout


def test_the_next_command_names_what_was_guessed(drive):
    words = ["rpil", "audit", drive, "--id", "trip", "--action", "steer,brake_pressure"]
    assert ok("info", drive).stdout.endswith(f"Next: {shlex.join(words)}\n")
    printed = ok("audit", drive).stdout.replace(" \\\n    ", " ")  # long commands go on in the next line
    assert f"Then run: {shlex.join(words)} --labels labels.csv" in printed
    assert "Guess" not in ok(*words[1:]).stderr
    assert (
        "Guess: action steer, brake_pressure; to change it, give --action." in ok("info", drive, "--id", "trip").stderr
    )


@pytest.mark.parametrize(
    "words",
    [
        ("keep", "-o", "new.csv"),
        ("fit", "-o", "policy"),
        ("convert", "-o", "new.csv"),
        ("check", "--fail-on", "any"),
        ("audit", "--fail-on", "bad"),
        ("audit", "--keep", "k.json"),
    ],
    ids=" ".join,
)
def test_nothing_is_decided_by_a_guess(words, drive):
    refused("no column says which demonstration a row is from", words[0], drive, *words[1:])
    with pytest.raises(DataError, match="no column says which demonstration"):
        rpil.open(drive)
    with pytest.raises(TypeError, match="no option 'guess'"):
        rpil.open(drive, guess=True)


def test_a_driver_of_several_runs_is_no_guess(tmp_path):
    one = drives().drop_columns(["day", "trip"]).append_column("driver", [np.arange(300) // 100])
    laps, action = np.arange(300) // STEPS % 4, ("--action", "steer")
    said = "column 'lap' changes within this demonstration; .* or, if '{}' is one, say so with --id"
    for name, more, words in (
        ("again", {}, "'clock' starts again, .* only a guess; .* begins there, give --split-gap 1, else --id driver"),
        ("lap", {"lap": laps, "clock": np.arange(300) / 20}, said.format("driver")),
        ("run", {"run": laps}, said.format("run").replace("lap", "driver")),
    ):
        path = tmp_path / f"{name}.csv"
        pa.csv.write_csv(pa.table({column: one[column] for column in one.column_names} | more), path)
        refused(words, "info", path)
    legs = pa.array([[0.5, 0.25]] * 300)
    pq.write_table(one.append_column("legs", legs).drop_columns("clock"), tmp_path / "legs.parquet")
    assert "3 demonstrations" in ok("info", tmp_path / "legs.parquet").stdout  # a list is the number of no part
    assert "3 demonstrations" in ok("info", tmp_path / "lap.csv", "--id", "driver").stdout
    assert "12 demonstrations" in ok("info", tmp_path / "again.csv", "--split-gap", "1", *action).stdout


@pytest.mark.parametrize(
    ("column", "values", "said"),
    [
        ("clock", drives()["clock"], "'clock' looks like a time, or the number of a step"),
        ("row", np.arange(300), "'row' would make 300 demonstrations of 300 steps"),
        ("odometer", np.arange(300) // 1.5, "'odometer' would make 200 demonstrations of 300 steps"),
        ("done", (np.arange(300) + 1) % STEPS == 0, "'done' is yes or no"),
    ],
)
def test_an_id_that_makes_no_demonstrations_is_a_question(column, values, said, drive):
    table = drives() if column == "clock" else drives().append_column(column, [values])
    pa.csv.write_csv(table.rename_columns({"clock": "time"}) if column == "clock" else table, drive)
    column = "time" if column == "clock" else column
    done = call("info", drive, "--id", column)
    assert done.exit_code == 2
    assert said.replace("clock", "time") in done.stderr


def test_many_demonstrations_of_one_step_are_read_by_their_names(drive):
    pa.csv.write_csv(drives().append_column("episode", [np.arange(300)]), drive)
    assert "Each demonstration has one step" in ok("info", drive, "--action", "steer").stdout
