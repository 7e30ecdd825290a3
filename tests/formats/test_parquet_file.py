"""Parquet files that lie or are damaged: one sentence, whatever pyarrow does with them and whatever pages they have."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil
from hostile import write_letters, write_long_list
from rpil.data import memory
from rpil.data.errors import DataError
from rpil.formats.parquet_file import check_sizes, fields_of
from rpil.formats.registry import find

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


@pytest.mark.parametrize("how", [{}, {"row_group_size": 100}, {"data_page_version": "2.0", "compression": "zstd"}])
def test_bytes_are_those_of_the_footer(tmp_path, how):
    path = tmp_path / "x.parquet"
    pq.write_table(TABLE, path, **how)
    n = how.get("row_group_size", ROWS)
    with pq.ParquetFile(path) as file:
        assert check_sizes(file, ["state.pos", "action.x"], path) == [16 * 7 * n] * (ROWS // n)
        assert check_sizes(file, ["few", "state"], path) == [16 * n] * (ROWS // n)
        assert sum(check_sizes(file, ["ragged"], path)) == 16 * sum(max(k % 3, 1) for k in range(ROWS))


@pytest.mark.parametrize("on_disk", [False, True])
def test_a_list_or_a_text_longer_than_any_is_refused(tmp_path, on_disk):
    write_long_list(tmp_path / "x.parquet", 2 * 10**6)
    with pytest.raises(DataError, match=r"^x\.parquet: column 'observation\.x' has 2,000,000 numbers in a list"):
        rpil.open(tmp_path / "x.parquet", on_disk=on_disk)
    write_letters(tmp_path / "x.parquet", 2 * 10**6)
    with pytest.raises(DataError, match=r"^x\.parquet: column 'comment' has 2,000,000 bytes in a text"):
        rpil.read(tmp_path / "x.parquet")


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
    with pytest.raises(DataError, match=r"x\.parquet: .* 2\.\d\d MB of memory"):
        find(path).keep(tmp_path / "other.parquet", [1])
    assert not (tmp_path / "other.parquet").exists()


@pytest.mark.parametrize("on_disk", [False, True])
def test_pages_with_more_values_than_the_footer_says_are_not_decoded(tmp_path, on_disk):
    path = tmp_path / "x.parquet"
    write_long_list(path, 10**6, says=2)
    with pytest.raises(DataError, match=r"^x\.parquet: pages of observation\.x\.list\.element hold more values than"):
        rpil.open(path, on_disk=on_disk)


def test_a_header_that_does_not_end_is_an_error():
    for content in (b"\x15", bytes([0x1C]) * 5000, np.full(5000, 255, np.uint8).tobytes()):
        with pytest.raises((IndexError, RecursionError)):
            fields_of(io.BytesIO(content))


def test_rows_with_images_are_kept_a_thousand_at_a_time(tmp_path, monkeypatch):
    """What their bytes take in memory no footer says."""
    sizes, batches = [], pq.ParquetFile.iter_batches
    monkeypatch.setattr(
        pq.ParquetFile, "iter_batches", lambda file, n, **own: sizes.append(n) or batches(file, n, **own)
    )
    rows = pa.table({"episode_index": np.repeat(range(4), 600), "x": np.arange(2400.0), "action": np.arange(2400.0)})
    pq.write_table(rows.append_column("image", pa.array([{"bytes": b"png"}] * len(rows))), tmp_path / "a.parquet")
    find(tmp_path / "a.parquet").keep(tmp_path / "kept.parquet", [1, 2])
    assert sizes[-1] == 1000
    assert pq.read_table(tmp_path / "kept.parquet").equals(pq.read_table(tmp_path / "a.parquet").slice(600, 1200))


def test_headers_of_pages_are_read_as_thrift_writes_them():
    short = [0x15, 3, 0x26, 0x80, 1, 0x1C, 0x14, 10, 0, 5, 18, 2, 0x18, 2, 97, 98, 0x17, *range(8), 0x13, 9, 0x11]
    found, end = {(1,): -2, (3,): 64, (4, 1): 5, (9,): 1, (14,): 2}, [0x15, 4, 0]
    long = bytes([0x18, 0x88, 0x27, *[97] * 5000, *end])  # whose text has 39 * 128 + 8 bytes
    for content, fields in ((bytes([*short, *end]), found), (long, {(2,): 2})):
        assert fields_of(stream := io.BytesIO(content)) == fields
        assert stream.tell() == len(content)
