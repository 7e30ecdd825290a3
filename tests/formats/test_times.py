"""What a recording says about its own times."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from rpil.formats import ColumnOptions, read_recording

IDS = np.array([7, 7, 3, 3, 7])  # the rows of one demonstration need not lie together
TIMES = np.array([0.0, 0.1, 5.0, 5.1, 0.2])
IN_ORDER = [0.0, 0.1, 0.2, 5.0, 5.1]
TABLE = pa.table({"episode_index": IDS, "timestamp": TIMES, "observation": TIMES**2, "action": [0, 1, 0, 1, 1]})


def timestamps(path, **options):
    return read_recording(path, **options).times().timestamps


def with_times(values):
    return TABLE.set_column(1, "timestamp", pa.array(values))


def csv_text(table):
    sink = pa.BufferOutputStream()
    pa.csv.write_csv(table, sink)
    return sink.getvalue().to_pybytes()


def write_hdf5(path):
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    with h5py.File(path, "w") as file:
        for name, rows in (("demo_0", [0, 1, 4]), ("demo_1", [2, 3])):
            for column in ("timestamp", "observation", "action"):
                file[f"data/{name}/{column}"] = TABLE[column].to_numpy()[rows]


@pytest.mark.parametrize("name", ["a.csv", "a.npz", "a.hdf5"])
def test_timestamps_come_in_the_order_of_the_demonstrations_from_every_format(tmp_path, name):
    path = tmp_path / name
    if name == "a.csv":
        path.write_bytes(csv_text(TABLE))
    elif name == "a.npz":
        arrays = {"observations": TIMES[:, None], "actions": np.array([0, 1, 0, 1, 1]), "timestamps": TIMES}
        np.savez(path, episode_ids=IDS, **arrays)
    else:
        write_hdf5(path)
    np.testing.assert_allclose(timestamps(path), IN_ORDER, atol=1e-12)


def test_times_that_are_missing_are_not_a_number(tmp_path):
    pq.write_table(with_times([0.0, None, 5.0, 5.1, 0.2]), tmp_path / "a.parquet")
    np.testing.assert_array_equal(np.isnan(timestamps(tmp_path / "a.parquet")), [False, True, False, False, False])


@pytest.mark.parametrize("unit", ["ms", "ns"])
def test_timestamps_are_in_seconds(tmp_path, unit):
    times = pa.array((TIMES * (1e3 if unit == "ms" else 1e9)).astype(np.int64))
    pq.write_table(with_times(times).rename_columns(["id", f"time_{unit}", "x", "action"]), tmp_path / "a.parquet")
    np.testing.assert_allclose(timestamps(tmp_path / "a.parquet"), IN_ORDER, atol=1e-9)
    typed = with_times(times.cast(pa.timestamp(unit))).rename_columns(["id", "recorded", "x", "action"])
    pq.write_table(typed, tmp_path / "b.parquet")
    found = timestamps(tmp_path / "b.parquet", options=ColumnOptions(order="recorded"))
    np.testing.assert_allclose(found, IN_ORDER, atol=1e-9)


def test_a_number_that_does_not_grow_is_no_time(tmp_path):
    """Such as the time of a reaction, which the name does not tell from the time of the step."""
    times = with_times([0.3, 0.2, 0.5, 0.1, 0.3]).rename_columns(["id", "reaction_time", "x", "action"])
    pq.write_table(times, tmp_path / "a.parquet")
    assert timestamps(tmp_path / "a.parquet", options=ColumnOptions(id="id")) is None


def test_robomimic_says_its_lengths(tmp_path):
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    with h5py.File(tmp_path / "lift.hdf5", "w") as file:
        for name, number in (("demo_0", 3), ("demo_1", 9), ("demo_2", "many")):
            file[f"data/{name}/actions"] = np.zeros((3, 2))
            file[f"data/{name}/obs/x"] = np.zeros((3, 2))
            file[f"data/{name}"].attrs["num_samples"] = number
    assert read_recording(tmp_path / "lift.hdf5").times().frames == {"demo_0": 3, "demo_1": 9}
