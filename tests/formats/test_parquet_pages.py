"""Values of lists are counted by the headers of pages, whatever pages a writer makes."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil
from hostile import write_long_list
from rpil.data.errors import DataError
from rpil.formats import parquet_file

LISTS = [[float(k)] * (k % 5) for k in range(3000)]
TEXTS = [["a" * 3000, "b"]] * 3000


def column(path, name):
    with pa.OSFile(str(path)) as stream, pq.ParquetFile(stream) as file:
        (k,) = (k for k in range(len(file.schema)) if file.schema.column(k).path.startswith(name))
        parquet_file.check_pages(file, stream, [k], path.name)
        chunk = file.metadata.row_group(0).column(k)
        place, n_values, n_pages = chunk.data_page_offset, 0, 0
        while place < (chunk.dictionary_page_offset or chunk.data_page_offset) + chunk.total_compressed_size:
            header, n_bytes = parquet_file._header_at(stream, place)
            n_values += header.get((5, 1), header.get((8, 1), 0))
            place, n_pages = place + n_bytes + header[3,], n_pages + 1
        return n_values == chunk.num_values, n_pages


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("compression", ["none", "snappy", "zstd"])
@pytest.mark.parametrize("dictionary", [False, True])
def test_values_of_all_pages_are_counted(tmp_path, version, compression, dictionary):
    path = tmp_path / "x.parquet"
    how = {"data_page_version": version, "compression": compression, "write_page_checksum": dictionary}
    pq.write_table(
        pa.table({"list": LISTS, "text": TEXTS}), path, use_dictionary=dictionary, data_page_size=1000, **how
    )
    for name in ("list", "text"):  # the header of texts is longer than is read at first
        is_all, n_pages = column(path, name)
        assert is_all
        assert n_pages > 1


@pytest.mark.parametrize("on_disk", [False, True])
def test_pages_with_more_values_than_the_footer_says_are_not_decoded(tmp_path, on_disk):
    path = tmp_path / "x.parquet"
    write_long_list(path, 10**6, says=2)
    with pytest.raises(DataError, match=r"^x\.parquet: pages of observation\.x\.list\.element hold more values than"):
        rpil.open(path, on_disk=on_disk)


def test_a_header_that_does_not_end_is_an_error():
    for content in (b"\x15", bytes([0x1C]) * 5000, np.full(5000, 255, np.uint8).tobytes()):
        stream = pa.BufferReader(content)
        with pytest.raises((IndexError, RecursionError)):
            parquet_file._header_at(stream, 0)
