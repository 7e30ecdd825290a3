"""What a recording says about its own times."""

from __future__ import annotations

import gzip
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from rpil import DataError
from rpil.data.formats.times import read_times

IDS = np.array([7, 7, 3, 3, 7])  # the rows of one demonstration need not lie together
TIMES = np.array([0.0, 0.1, 5.0, 5.1, 0.2])
IN_ORDER = [0.0, 0.1, 0.2, 5.0, 5.1]


@pytest.fixture
def table():
    return pa.table({"episode_index": IDS, "timestamp": TIMES, "action": IDS})


def test_timestamps_come_in_the_order_of_the_demonstrations(tmp_path, table):
    pq.write_table(table, tmp_path / "data.parquet")
    (tmp_path / "data.csv").write_text(table.to_pandas().to_csv(index=False))
    (tmp_path / "data.tsv.gz").write_bytes(gzip.compress(table.to_pandas().to_csv(index=False, sep="\t").encode()))
    np.savez(tmp_path / "data.npz", allow_pickle=False, episode_ids=IDS, timestamps=TIMES)
    for name in ("data.parquet", "data.csv", "data.tsv.gz", "data.npz"):
        np.testing.assert_allclose(read_times(tmp_path / name, (7, 3)).timestamps, IN_ORDER)


def test_without_timestamps_nothing_is_known(tmp_path, table):
    pq.write_table(table.drop_columns("timestamp"), tmp_path / "data.parquet")
    pq.write_table(table.set_column(1, "timestamp", pa.array(list("abcde"))), tmp_path / "text.parquet")
    for name in ("data.parquet", "text.parquet"):
        assert read_times(tmp_path / name, (7, 3)).timestamps is None


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_lerobot_says_its_frame_rate_and_lengths(tmp_path, table, version):
    meta = tmp_path / "meta"
    (tmp_path / "data").mkdir()
    (meta / "episodes").mkdir(parents=True)
    pq.write_table(table, tmp_path / "data" / "file-000.parquet")
    (meta / "info.json").write_text(json.dumps({"fps": 10, "codebase_version": version}))
    lengths = {"episode_index": [3, 7], "length": [2, 3]}
    if version == "v3.0":
        pq.write_table(pa.table(lengths), meta / "episodes" / "file-000.parquet")
    else:
        rows = [{"episode_index": 3, "length": 2}, {"episode_index": 7, "length": 3}]
        (meta / "episodes.jsonl").write_text("\n".join(map(json.dumps, rows)))
    found = read_times(tmp_path, (7, 3))
    assert (found.fps, found.frames) == (10.0, {3: 2, 7: 3})
    np.testing.assert_allclose(found.timestamps, IN_ORDER)


@pytest.mark.parametrize("content", ["{", "[]", '"text"'])
def test_damaged_description_is_refused(tmp_path, table, content):
    (tmp_path / "meta").mkdir()
    pq.write_table(table, tmp_path / "file.parquet")
    (tmp_path / "meta" / "info.json").write_text(content)
    with pytest.raises(DataError, match="info"):
        read_times(tmp_path, (7, 3))


def test_robomimic_says_its_lengths(tmp_path):
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    with h5py.File(tmp_path / "lift.hdf5", "w") as file:
        for name, number in (("demo_0", 3), ("demo_1", 9), ("demo_2", "many")):
            file[f"data/{name}/actions"] = np.zeros((3, 2))
            file[f"data/{name}"].attrs["num_samples"] = number
    assert read_times(tmp_path / "lift.hdf5", ("demo_0", "demo_1", "demo_2")).frames == {"demo_0": 3, "demo_1": 9}
