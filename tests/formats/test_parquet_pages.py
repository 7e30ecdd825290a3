"""The numbers in lists are counted as pyarrow decodes them, whatever the footer says."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pyarrow import fs

import lerobot_folders as folders
import rpil
from hostile import write_long_list
from rpil.data import memory
from rpil.data.errors import DataError
from rpil.formats.lerobot.defects import find_defects
from rpil.formats.parquet_pages import OpenParquet, page_sizes
from rpil.formats.registry import find
from rpil.formats.store import opened

ROWS = 500
TABLE = pa.table(
    {
        "action.x": np.arange(ROWS),
        "state.pos": list(np.random.default_rng(0).normal(size=(ROWS, 6))),
        "few": pa.array([[1.5]] * ROWS, pa.list_(pa.float32(), 1)),
        "ragged": [list(range(k % 3)) for k in range(ROWS)],
        "text": ["a" * 300] * ROWS,
    }
)


def sizes(path, *columns):
    with opened(fs.LocalFileSystem(), str(path)) as stored:
        return page_sizes(stored, columns)


def counted(path, *columns):
    """The numbers in lists."""
    return [sum(chunk.n_values for chunk in chunks if chunk.is_list) for chunks in sizes(path, *columns)]


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"row_group_size": 100},
        {"data_page_version": "2.0", "compression": "zstd"},
        {"use_dictionary": False, "compression": None, "data_page_size": 500, "write_page_checksum": True},
        {"write_statistics": False, "write_page_index": True, "store_schema": False},
    ],
    ids=str,
)
def test_numbers_are_counted(tmp_path, how):
    path = tmp_path / "x.parquet"
    pq.write_table(TABLE, path, **how)
    n_groups = ROWS // how.get("row_group_size", ROWS)
    assert counted(path, "state.pos", "action.x") == [6 * ROWS // n_groups] * n_groups
    assert counted(path, "few", "state") == [ROWS // n_groups] * n_groups
    assert counted(path, "text", "action.x") == [0] * n_groups
    # An empty list is stored as one value.
    assert sum(counted(path, "ragged")) == sum(max(k % 3, 1) for k in range(ROWS))


def test_bytes_are_those_of_decoded_pages(tmp_path):
    path = tmp_path / "x.parquet"
    plain = {"use_dictionary": False, "compression": "zstd"}
    pq.write_table(TABLE, path, **plain, data_page_size=1000, write_batch_size=10)
    [[chunk]] = sizes(path, "text")
    assert ROWS * 304 <= chunk.n_bytes < ROWS * 310
    assert (chunk.n_values, chunk.largest < 10_000) == (ROWS, True)
    pq.write_table(TABLE, path, compression="zstd")
    [[chunk]] = sizes(path, "text")  # of a dictionary with one text
    assert 304 <= chunk.largest < chunk.n_bytes < 1000


def test_the_pages_are_believed_and_not_the_footer(tmp_path):
    path = tmp_path / "x.parquet"
    write_long_list(path, 10**6, says=2)
    assert len(pq.read_table(path)["observation.x"][1]) == 10**6
    assert counted(path, "observation.x") == [10**6 + 1]
    with pytest.raises(DataError, match=r"x\.parquet: .* 16\.0 MB of memory"):
        rpil.read(path, memory="1MB")


def test_damaged_files_are_refused_and_end_no_process(tmp_path):
    path, rng = tmp_path / "x.parquet", np.random.default_rng(0)
    pq.write_table(TABLE.slice(0, 20), path)
    content = path.read_bytes()
    file = pq.ParquetFile(path)
    for _ in range(250):
        bad = bytearray(content)
        bad[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
        path.write_bytes(bad)
        try:
            with fs.LocalFileSystem().open_input_file(str(path)) as stream:
                groups = page_sizes(OpenParquet(file, stream, path.name), ["state.pos", "text"])
        except DataError as error:
            assert "x.parquet" in str(error)  # noqa: PT017
        else:
            assert all(chunk.n_values >= 0 and chunk.n_bytes >= 0 for chunks in groups for chunk in chunks)


def test_columns_that_are_kept_and_not_read_are_checked(tmp_path, monkeypatch):
    path, rows = tmp_path / "x.parquet", 4 * ROWS
    data = {"episode_index": np.repeat(range(4), ROWS), "action": np.arange(rows), "observation.x": np.arange(rows)}
    table = pa.table(data | {"images": [{"bytes": bytes([k % 256]) * 1000} for k in range(rows)]})
    how = {"use_dictionary": False, "compression": "zstd"}
    pq.write_table(table, path, row_group_size=ROWS, **how)  # each row group alone fits
    monkeypatch.setattr(memory, "free_memory", lambda: 2e6)
    find(path).keep(tmp_path / "kept.parquet", [1])
    assert len(pq.read_table(tmp_path / "kept.parquet")) == ROWS
    pq.write_table(table, path, **how)
    with pytest.raises(DataError, match=r"x\.parquet: .* 2\.\d MB of memory"):
        find(path).keep(tmp_path / "other.parquet", [1])
    assert not (tmp_path / "other.parquet").exists()


@pytest.mark.parametrize("is_trim", [False, True])
def test_columns_that_statistics_name_are_checked(tmp_path, is_trim, monkeypatch):
    root = folders.write(tmp_path / "drive", (4, 5), "v3.0", ())
    file = root / "data" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(file)
    values = pa.array([[0.0] * 30_000] * len(table), pa.list_(pa.float64()))
    pq.write_table(table.append_column("huge", values), file, compression="zstd")
    stats = json.loads((root / "meta" / "stats.json").read_text()) | {"huge": {"min": [0], "mean": [0]}}
    (root / "meta" / "stats.json").write_text(json.dumps(stats))
    with monkeypatch.context() as little:
        little.setattr(memory, "free_memory", lambda: 2e6)
        (defect,) = [one for one in find_defects(root, False) if one.what == "metadata"]
        assert "column 'huge': to read it would take" in defect.sentence
        with pytest.raises(DataError, match="MB of memory"):
            rpil.open(root).keep([1], tmp_path / "kept", {1: (0, 4)} if is_trim else {})
    assert not [one for one in find_defects(root, False) if one.what == "metadata"]
