"""Demonstrations that end at pauses, stretches, and columns of LeRobot's ``meta/episodes``."""

from contextlib import nullcontext

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest

import rpil
from command_line import ok, refused, write_lines
from episode_rows import N, T, episodes, written
from rpil.data.errors import DataError
from samples import assert_same

SECONDS = np.array([0.0, 0.1, 0.2, 5.0, 5.1, 0.0, 0.1, 0.2])
"""A pause of 4.8 s before the fourth row, and a clock that begins anew before the sixth."""

STAMPS = [f"2026-05-01T08:00:{second:04.1f}+02:00".replace(".0+", "+") for second in SECONDS]
"""The same as ISO 8601 writes it."""


def rows(**columns):
    rng = np.random.default_rng(0)
    return pa.table(columns | {"x": rng.normal(size=8), "action": rng.normal(size=8)})


@pytest.mark.parametrize(
    "clock",
    [
        {"time_s": SECONDS},
        {"time_ms": (1000 * SECONDS).astype(int)},
        {"stamp": STAMPS},
        {"time_ms": STAMPS},  # whatever the name says of a unit
        {"timestamp": pa.array((SECONDS * 1e6).astype(int)).cast(pa.timestamp("us"))},
    ],
    ids=lambda clock: next(iter(clock)),
)
@pytest.mark.parametrize("suffix", ["csv", "frame"])
def test_a_demonstration_ends_at_a_pause_and_where_the_clock_goes_back(clock, suffix, tmp_path):
    table, path = rows(**clock), tmp_path / f"a.{suffix}"
    if suffix == "csv":
        pa.csv.write_csv(table, path)
    recording = rpil.open(table if suffix == "frame" else path, split_gap=1.0)
    assert recording.demonstrations.ids == (0, 1, 2)
    assert recording.demonstrations.lengths.tolist() == [3, 2, 3]
    assert recording.description.id_column == "pauses in time"
    np.testing.assert_array_equal(recording.demonstrations.actions.ravel(), table["action"].to_numpy())
    longer = rpil.open(table if suffix == "frame" else path, split_gap=4.9)
    assert longer.demonstrations.lengths.tolist() == [5, 3]


@pytest.mark.parametrize("name", ["date", "timestamp"])
def test_a_text_of_a_date_that_stays_in_each_demonstration_is_no_clock(name):
    trip = np.repeat([0, 1], [5, 3])
    days = rows(trip=trip, **{name: [f"2026-05-0{m + 1}" for m in trip]})
    recording = rpil.open(days, id="trip")
    assert recording.description.fps is None
    assert recording.times().timestamps is None


def test_a_demonstration_goes_on_in_the_next_file_unless_its_steps_count_anew(tmp_path):
    for name, part in (("a", slice(0, 5)), ("b", slice(5, 8))):
        table = rows(trip=[0, 0, 0, 1, 1, 1, 2, 2], time=[1, 1, 1, 2, 2, 2, 3, 3])
        pa.csv.write_csv(table.slice(part.start, part.stop - part.start), tmp_path / f"{name}.csv")
    assert rpil.read(tmp_path, id="trip").lengths.tolist() == [3, 3, 2]
    pa.csv.write_csv(rows(trip=[1] * 8, time=[0, 0, 1, 1, 2, 2, 3, 3]), tmp_path / "b.csv")
    with pytest.raises(DataError, match=r"demonstration 1: it is both in a\.csv and in b\.csv; .* exclude= trip"):
        rpil.read(tmp_path, id="trip")


def test_named_demonstrations_are_split_further(tmp_path):
    table = rows(time_s=SECONDS, trip=["a", "a", "a", "a", "a", "b", "b", "b"])
    assert rpil.open(table, id="trip", split_gap=1).demonstrations.ids == ("a-0", "a-1", "b-0")
    folder = tmp_path / "drives"
    folder.mkdir()
    for name, part in (("p", table.slice(0, 5)), ("q", table.slice(5))):
        pa.csv.write_csv(part.drop_columns(["trip"]), folder / f"{name}.csv")
    assert rpil.open(folder, split_gap=1).demonstrations.ids == ("p-0", "p-1", "q-0")


def test_a_log_is_split_by_its_times_and_its_action_is_found():
    seconds = [*SECONDS[:5], 9.0, 9.1, 9.2]
    lines = [f"{second}, {k % 3 / 10}, .{k + 1}, {k}.5" for k, second in enumerate(seconds)]
    words = [write_lines("driving_log.csv", lines)]
    refused("put the names of its 4 columns above it, or give a frame in Python", "info", *words)
    write_lines("driving_log.csv", ["time_s,steering,accel_cmd,nav_command", *lines])
    refused("or end demonstrations at pauses with --split-gap", "info", *words)
    done = ok("info", *words, "--split-gap", "1")
    assert "3 demonstrations, 8 steps, 0.5 s at 10 a second" in done.stdout
    assert "Action: steering, accel_cmd;" in done.stdout
    ok("convert", *words, "--split-gap", "1", "--action", "steering", "-o", "log.parquet")
    assert len(rpil.read("log.parquet")) == 3
    refused("first run rpil convert driving_log.csv --split-gap 1 -o ALL.parquet", "keep", *words, "--split-gap", "1",
            "--action", "steering", "-o", "new.csv", "--share", ".9")  # fmt: skip


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({}, "no column is a time in seconds, which ends demonstrations"),
        ({"t": np.arange(8)}, "no column is a time in seconds"),  # of which nothing says the unit
        ({"center": ["a_2021_10_25_16_31_20"] * 8}, "make one of times in texts"),
    ],
)
def test_a_time_must_be_known(columns, said):
    with pytest.raises(DataError, match=said):
        rpil.open(rows(**columns), split_gap=1)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_stretch_of_a_recording_is_a_demonstration(suffix, tmp_path):
    path = written(episodes(phase=None), suffix, tmp_path)
    read = rpil.read(path, segment=1.0)
    assert read.ids[:4] == ("e0 [0, 1) s", "e0 [1, 2) s", "e0 [2, 3) s", "e1 [0, 1) s")
    assert read.lengths[:4].tolist() == [10, 10, 5, 10]
    assert_same(rpil.open(path, segment=1.0, on_disk=True).demonstrations.select(slice(None)), read)


def test_stretches_begin_again_after_a_pause_and_need_no_id():
    clock = np.tile(np.arange(T) * 0.1, N) + 100 * np.repeat(np.arange(N), T)
    read = rpil.read(episodes(episode=None, time_s=clock), segment=2.0, split_gap=5.0)
    assert read.ids[:3] == ("0 [0, 2) s", "0 [2, 4) s", "1 [0, 2) s")
    assert rpil.read(episodes(episode=None, time_s=clock), segment=600.0).ids == ("0 [0, 600) s", "0 [600, 1200) s")
    frame = episodes(episode=None, time_s=clock, pauses=clock)  # a name like any other
    assert rpil.read(frame, observations="pauses", split_gap=5.0).observation_names == ("pauses",)
    with pytest.raises(DataError, match="the column of time lacks values; fill it in"):
        rpil.open(rows(time_s=[*range(7), np.nan]), segment=1)


@pytest.mark.parametrize("option", ["segment", "split_gap"])
def test_seconds_that_end_demonstrations_are_a_number_of_a_few_steps(option):
    for seconds in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(DataError, match=f"{option}= is {seconds}; give a number of seconds, more than 0"):
            rpil.read(episodes(), **{option: seconds})
    with pytest.raises(DataError, match="where split_gap= or segment= is given, give more seconds"):
        rpil.read(episodes(), **{option: 0.01})


GOOD, IN_ORDER = [0, 1, 2], "steps in the order of "
IN_FILE = IN_ORDER + "the file, because step has "
REPEATS = IN_FILE + "repeated values within a demonstration"
NO_NUMBERS = IN_FILE + "values that are missing, or neither numbers nor times"


@pytest.mark.parametrize(
    ("columns", "order", "refused"),
    [
        ({"step": [0, 1, 2, 2, 6, 7]}, IN_ORDER + "step", ""),
        ({"step": [0, 2, 1, *GOOD]}, "steps sorted by step, because rows of the file are out of order", ""),
        ({"step": [0, 1, 1, *GOOD]}, REPEATS, "0, row 3: order column 'step' repeats a value; name another"),
        ({"step": [0, 1, None, *GOOD]}, NO_NUMBERS, "0, row 1: order column 'step' needs .* row, as 20"),
        ({"step": [0, 1, 1, *GOOD], "timestamp": np.array(GOOD * 2) / 7}, IN_ORDER + "timestamp", "0, row 3"),
        ({"step": [0, 1, 1, *GOOD], "timestamp": ["a"] * 6}, REPEATS, "0, row 3"),
    ],
)
def test_the_first_column_that_tells_the_steps_is_the_order(columns, order, refused):
    table = pa.table({"episode": [0, 0, 0, 1, 1, 1], "x": np.arange(6) / 3, "action": np.arange(6) / 7} | columns)
    assert rpil.open(table).description.order == order
    with pytest.raises(DataError, match=refused) if refused else nullcontext():
        assert rpil.open(table, order="step").description.order == order


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("k", [0, 0, 1, 1, 2, 2, 3, 3], ""),
        ("k", [0, 0, 1, 1, 2, 2, 3, 4], "'k' would make 5 demonstrations of 8 steps; "),
        ("k", ["true", "False"] * 4, "column 'k' is yes or no, and no id; where it marks the ends"),
        ("k", [0, 1] * 4, ""),
        ("done", [0, 0, 0, 0, 1, 1, 1, 1], "column 'done' is yes or no, and no id; "),
        ("time", [1, 2, 1, 2, 1, 1, 1, 1], ""),
        ("time", [1, 2, 1, 2, 1, 2, 2, 2], "'time' looks like a time, or the number of a step, as it changes from row"),
    ],
)
def test_an_id_that_makes_no_demonstrations_is_a_question(name, values, said):
    with pytest.raises(DataError, match=f"^the frame: {said}") if said else nullcontext():
        assert rpil.read(rows(**{name: values}), id=name).ids == tuple(dict.fromkeys(values))
