"""Rows on disk: what is read there, of other formats from a copy, is what is read into memory."""

import gc
import os
import pickle
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from rpil import Dataset, formats
from rpil.data.errors import DataError
from rpil.formats import read_recording, registry, steps
from samples import assert_same_on_disk


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    monkeypatch.setattr(steps, "BATCH_ROWS", 7)
    monkeypatch.setattr("rpil.formats.step_arrays.BATCH_ROWS", 7)


@pytest.mark.parametrize("where", [".", ".."])
def test_a_folder_without_a_name_is_read_on_disk(tmp_path, monkeypatch, where):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    data = tmp_path / "data" / "below"
    data.mkdir(parents=True)
    folder = data if where == "." else data.parent
    for k in range(3):
        rows = "".join(f"{k},{i},{i % 2}\n" for i in range(9))
        (folder / f"{k}.csv").write_text(f"episode_id,observation,action\n{rows}")
    monkeypatch.chdir(data)
    assert len(read_recording(where, on_disk=True).demonstrations) == 3
    gc.collect()
    assert os.listdir(tmp_path) == ["data"]


def table(ids, actions, decimal="."):
    separator = ";" if decimal == "," else ","
    lines = [["episode_id", "step", "observation.x", "action", "task"]]
    rows = enumerate(zip(ids, actions, strict=True))
    lines += [[m, k, f"{k / 7:.3f}".replace(".", decimal), a, "lift"] for k, (m, a) in rows]
    return "".join(separator.join(map(str, line)) + "\n" for line in lines)


@pytest.mark.parametrize(
    ("ids", "actions", "decimal"),
    [
        (["1"] * 9 + ["2"] * 9, [0, 1, 1] * 6, "."),
        (["1"] * 9 + ["02"] * 9, [0, 1, 1] * 6, "."),  # the ids are text because the last one is
        (["a"] * 9 + ["b"] * 9, [0] * 17 + ["0.5"], "."),  # so is it with numbers
        (["a"] * 9 + ["b"] * 9, [0] * 17 + ["left"], "."),
        (["a"] * 9 + ["b"] * 9, ["0,25", 1, 2] * 6, ","),
        (["a"] * 9 + ["b"] * 9, ["-0"] * 12 + ["0.5", "01", 2] * 2, "."),  # -0 alone would be no number that comes back
        (["a"] * 9 + ["b"] * 9, ["0.5"] * 12 + ["12345678901234567890"] * 6, "."),
    ],
)
def test_text_tables(tmp_path, monkeypatch, ids, actions, decimal):
    monkeypatch.setattr("rpil.formats.csv._BLOCK_BYTES", 1 << 6)
    (tmp_path / "a.csv").write_text(table(ids, actions, decimal))
    assert_same_on_disk(tmp_path / "a.csv")


def test_types_that_differ_between_files_become_one(tmp_path):
    for name, times in (("a", "0123"), ("b", ["0", "0.5", "1", "1.5"])):
        rows = [f"{name},{t},0.5,{k % 2}\n" for k, t in enumerate(times)]
        (tmp_path / f"{name}.csv").write_text("".join(["episode,timestamp,x,action\n", *rows]))
    assert_same_on_disk(tmp_path)


def test_types_that_change_are_said(tmp_path, monkeypatch):
    for name in ("_HEAD_BYTES", "_BLOCK_BYTES"):
        monkeypatch.setattr(f"rpil.formats.csv.{name}", 1 << 6)
    rows = [f"a,{'late' if k > 90 else k},0.5,{k % 2}\n" for k in range(99)]
    (tmp_path / "a.csv").write_text("".join(["episode,timestamp,x,action\n", *rows]))
    with pytest.raises(DataError, match="of another type further on; write them alike, or allow more with memory="):
        read_recording(tmp_path / "a.csv", on_disk=True)


def test_copies_are_removed_with_their_rows(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    (tmp_path / "a.csv").write_text(table(["a"] * 9, [0, 1, 1] * 3))
    data = read_recording(tmp_path / "a.csv", on_disk=True).demonstrations
    shard = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(data.shards()[0]))))  # noqa: S301
    assert len(list((tmp_path / "temporary").iterdir())) == 1
    assert next(iter(shard)).observations.shape == (9, 1)
    del data, shard
    gc.collect()
    assert not list((tmp_path / "temporary").iterdir())


def test_large_data_go_to_disk_if_they_can(tmp_path, caplog, monkeypatch):
    (path := tmp_path / "a.csv").write_text(table(["a"] * 400 + ["b"] * 400, [0, 1] * 400))
    assert not isinstance((small := formats.open(path)).demonstrations, Dataset)
    assert (small.options.memory, caplog.messages) == (None, [])
    assert isinstance(formats.open(path, memory="50kB").demonstrations, Dataset)
    assert caplog.messages[0].startswith(f"{path}: large, so read from a copy on disk, in /")
    with pytest.raises(DataError, match="of memory, more than"):
        formats.read(path, memory="50kB")
    monkeypatch.setattr(registry, "MOST_IN_MEMORY", 50_000)
    assert isinstance(formats.open(path).demonstrations, Dataset)
    assert not isinstance(formats.open(path, memory="1GB").demonstrations, Dataset)
    monkeypatch.setenv("TMPDIR", str(tmp_path / "not there"))
    with pytest.raises(DataError, match=r"TMPDIR is .*not there, where no file can be .*allow more with memory="):
        formats.open(path)


@pytest.mark.skipif(not hasattr(os, "O_TMPFILE"), reason="only Linux has files without a name")
def test_a_process_that_is_ended_leaves_no_copy(tmp_path):
    (tmp_path / "a.csv").write_text(table(["a"] * 9, [0, 1, 1] * 3))
    (tmp_path / "temporary").mkdir()
    code = "import os, rpil, sys; data = rpil.open(sys.argv[1], on_disk=True); os.kill(os.getpid(), 9)"
    environment = os.environ | {"TMPDIR": str(tmp_path / "temporary")}
    ended = subprocess.run([sys.executable, "-c", code, str(tmp_path / "a.csv")], env=environment, check=False)
    assert ended.returncode == -9
    assert not list((tmp_path / "temporary").iterdir())


def test_a_disk_without_room_is_said(tmp_path, monkeypatch):
    pq.write_table(pa.table({"episode": ["a"] * 9, "x": [0.5] * 9, "action": [0, 1, 1] * 3}), tmp_path / "a.parquet")
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=100))
    with pytest.raises(DataError, match=r"a\.parquet: a copy .*it needs 0.00 GB, and 0.00 GB are free.*set TMPDIR"):
        read_recording(tmp_path / "a.parquet", on_disk=True)


def test_batches_are_opened_once_also_for_rows_all_over_the_file(monkeypatch):
    file = steps.ArrowFile.of(iter([pa.table({"x": np.arange(21.0)})]), "made")
    assert file.batch(1, ["x"]) is file.batch(1, ["x"])
    assert file.batch(2, ["x"])["x"].to_pylist() == np.arange(14.0, 21).tolist()
    monkeypatch.setattr(steps, "_BATCHES_AT_ONCE", 4)
    rows, read, batch = np.random.default_rng(0).permutation(7 * 40), [], steps.ArrowFile.batch
    file = steps.ArrowFile.of([pa.table({"x": np.arange(len(rows)) / 3})], "x")
    monkeypatch.setattr(steps.ArrowFile, "batch", lambda *own: read.append(own) or batch(*own))
    moved = steps.Steps(file, "x").taken(rows)
    assert len(read) <= 40 * 40 / 4
    assert np.array_equal(np.concatenate([one["x"] for _, one, _ in moved.tables(["x"])]), rows / 3)


def test_columns_of_a_batch_are_mapped_and_not_copied(monkeypatch):
    monkeypatch.setattr(steps, "BATCH_ROWS", 70_000)
    file = steps.ArrowFile.of(iter([pa.table({name: np.arange(70_000.0) for name in "xyz"})]), "made")
    allocated = pa.total_allocated_bytes()
    batch = file.batch(0, ["x"])
    assert pa.total_allocated_bytes() - allocated < batch.nbytes / 2
