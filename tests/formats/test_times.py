"""What a recording says about its own times."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from rpil import DataError
from rpil.formats import ColumnOptions, read_recording

IDS = np.array([7, 7, 3, 3, 7])  # the rows of one demonstration need not lie together
TIMES = np.array([0.0, 0.1, 5.0, 5.1, 0.2])
IN_ORDER = [0.0, 0.1, 0.2, 5.0, 5.1]
TABLE = pa.table({"episode_index": IDS, "timestamp": TIMES, "observation": TIMES**2, "action": [0, 1, 0, 1, 1]})
SORTED = TABLE.sort_by([("episode_index", "descending")])  # as data on disk have to be


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


@pytest.mark.parametrize("name", ["a.csv", "a.npz", "a.hdf5", "csv", "on disk"])
def test_timestamps_come_in_the_order_of_the_demonstrations_from_every_format(tmp_path, name):
    path = tmp_path / name
    if name == "a.csv":
        path.write_bytes(csv_text(TABLE))
    elif name == "a.npz":
        arrays = {"observations": TIMES[:, None], "actions": np.array([0, 1, 0, 1, 1]), "timestamps": TIMES}
        np.savez(path, episode_ids=IDS, **arrays)
    elif name == "a.hdf5":
        write_hdf5(path)
    else:
        path.mkdir()
        for k, part in enumerate((SORTED.slice(0, 3), SORTED.slice(3))):
            if name == "csv":
                (path / f"{k}.csv").write_bytes(csv_text(part))
            else:
                pq.write_table(part, path / f"{k}.parquet")
    np.testing.assert_allclose(timestamps(path, on_disk=name == "on disk"), IN_ORDER, atol=1e-12)


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


@pytest.fixture
def folder(tmp_path):
    """A data set as LeRobot writes it."""
    root = tmp_path / "set"
    for name in ("data", "meta/episodes"):
        (root / name).mkdir(parents=True)
    pq.write_table(TABLE, root / "data" / "file-000.parquet")
    (root / "meta" / "info.json").write_text(json.dumps({"fps": 10, "codebase_version": "v3.0"}))
    return root


@pytest.mark.parametrize("on_disk", [False, True])
@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_lerobot_says_its_frame_rate_and_lengths(folder, version, on_disk):
    lengths = {"episode_index": [3, 7, 8], "length": [2, 3, 9]}
    if version == "v3.0":
        pq.write_table(pa.table(lengths), folder / "meta" / "episodes" / "file-000.parquet")
    else:
        rows = [dict(zip(lengths, values, strict=True)) for values in zip(*lengths.values(), strict=True)]
        (folder / "meta" / "episodes.jsonl").write_text("\n".join(map(json.dumps, rows)))
    pq.write_table(SORTED, folder / "data" / "file-000.parquet")
    found = read_recording(folder, on_disk=on_disk).times()
    assert (found.fps, found.frames) == (10.0, {3: 2, 7: 3, 8: 9})
    np.testing.assert_allclose(found.timestamps, IN_ORDER, atol=1e-12)
    pq.write_table(SORTED.slice(0, 0), folder / "data" / "file-001.parquet")
    one_file = read_recording(folder / "data" / "file-000.parquet", on_disk=on_disk)
    assert not one_file.times().frames  # because others may hold the rest


@pytest.mark.parametrize("content", ["{", "[]", "\xff", "[" * 100_000])
def test_a_damaged_description_is_refused(folder, content):
    (folder / "meta" / "info.json").write_text(content, encoding="latin-1")
    for on_disk in (False, True):
        with pytest.raises(DataError, match=r"info\.json"):
            read_recording(folder, on_disk=on_disk)


def test_robomimic_says_its_lengths(tmp_path):
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    with h5py.File(tmp_path / "lift.hdf5", "w") as file:
        for name, number in (("demo_0", 3), ("demo_1", 9), ("demo_2", "many")):
            file[f"data/{name}/actions"] = np.zeros((3, 2))
            file[f"data/{name}/obs/x"] = np.zeros((3, 2))
            file[f"data/{name}"].attrs["num_samples"] = number
    assert read_recording(tmp_path / "lift.hdf5").times().frames == {"demo_0": 3, "demo_1": 9}
