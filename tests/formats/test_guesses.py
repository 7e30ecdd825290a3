"""Names that drivers and pilots use, and ids that make no demonstrations."""

import numpy as np
import pyarrow as pa
import pyarrow.csv

import rpil
from command_line import refused

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


def test_trips_and_what_drivers_steer_with_are_found_by_name():
    pa.csv.write_csv(drives(), "my drive.csv")
    for data in ("my drive.csv", drives()):
        recording = rpil.open(data)
        assert len(recording.demonstrations) == 12
        assert recording.description.actions == ("steer", "brake_pressure")
    table = drives().append_column("stick_x", [np.zeros(300)]).append_column("obs.stick", [np.zeros(300)])
    assert rpil.open(table).description.actions == ("steer", "brake_pressure", "stick_x")
    assert rpil.open(drives().drop_columns(["brake_pressure"])).description.action_kind == "continuous"
    assert rpil.open(drives().append_column("action", [np.arange(300) % 2])).description.actions == ("action",)


def test_pedals_alone_are_no_action_because_the_wheel_may_have_a_name_of_another_language(tmp_path):
    pa.csv.write_csv(drives().rename_columns({"steer": "Lenkwinkel", "brake_pressure": "Pedal"}), tmp_path / "d.csv")
    said = "no column holds the action: name it action, or name the columns with --action .*'Lenkwinkel', 'Pedal'"
    refused(said, "info", tmp_path / "d.csv")
