"""Codecs and types that are not on the list are refused before any library is asked for them."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import rpil
from rpil.data.errors import DataError
from rpil.formats.registry import find
from rpil.formats.zarr_header import parse_header

TOOLS = Path(__file__).parents[2] / "tools"
FORMAT_2 = {
    "zarr_format": 2,
    "shape": [11, 2],
    "chunks": [3, 2],
    "dtype": "<f4",
    "compressor": {"id": "zlib", "level": 1},
    "filters": None,
    "fill_value": 0,
    "order": "C",
}
BYTES = {"name": "bytes", "configuration": {"endian": "little"}}
FORMAT_3 = {
    "zarr_format": 3,
    "node_type": "array",
    "shape": [11, 2],
    "data_type": "float32",
    "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [3, 2]}},
    "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
    "fill_value": 0,
    "codecs": [BYTES, {"name": "gzip", "configuration": {"level": 5}}],
    "attributes": {},
}
PICKLE = {"id": "pickle"}


def sharded(**changes):
    inner = {"chunk_shape": [1, 2], "codecs": [BYTES], "index_codecs": [BYTES, {"name": "crc32c"}]}
    return {"codecs": [{"name": "sharding_indexed", "configuration": inner | changes}]}


def parse(about, **changes):
    return parse_header(json.dumps({**about, **changes}).encode(), "buffer.zarr: data/x")


@pytest.mark.parametrize("disguise", ["x.zarr", "x.zarr.zip", "x.npz", "x.csv"])
@pytest.mark.parametrize("place", ["ends-filter", "ends-compressor", "data-filter"])
def test_a_store_that_runs_code_reaches_no_library(tmp_path, monkeypatch, place, disguise):
    monkeypatch.syspath_prepend(str(TOOLS))
    import hostile_zarr

    hostile_zarr.write_store(tmp_path / "store", place, tmp_path / "marker")
    path = tmp_path / disguise
    hostile_zarr.disguise(tmp_path / "store", path)
    for library in ("zarr", "zarr.storage", "numcodecs"):
        monkeypatch.setitem(sys.modules, library, None)  # to import it is an ImportError, which is no DataError
    with pytest.raises(DataError, match="'pickle'" if ".zarr" in disguise else disguise):
        rpil.read(path)
    with pytest.raises(DataError):
        find(path).keep(tmp_path / f"kept{path.suffix}", [0])
    assert not (tmp_path / "marker").exists()


@pytest.mark.parametrize(
    "changes",
    [
        {"compressor": PICKLE},
        {"filters": [PICKLE]},
        {"filters": [{"id": "delta", "dtype": "<f4"}, PICKLE]},
        {"filters": [{"id": "json2"}]},
        {"dtype": "|O", "filters": [{"id": "vlen-utf8"}, PICKLE]},
        {"dtype": "|O", "filters": [{"id": "vlen-utf8"}], "compressor": PICKLE},
        {"dtype": "|O", "filters": [PICKLE, {"id": "vlen-utf8"}]},
        {"dtype": "|O"},
        {"dtype": "O"},
        {"dtype": "f8,O"},
        {"dtype": [["a", "<f4"]]},
        {"dtype": "|V8"},
        {"filters": [{"id": "vlen-utf8"}]},
        {"filters": [{"id": "delta", "dtype": "|O"}]},
        {"filters": [{"id": "fixedscaleoffset", "dtype": "<f4", "astype": "|O", "scale": 1, "offset": 0}]},
        {"compressor": {"id": "imagecodecs_jpegxl"}, "filters": [PICKLE]},
        {"compressor": {"id": ["pickle"]}},
    ],
    ids=str,
)
def test_refused_in_format_2(changes):
    with pytest.raises(DataError, match=r"^buffer.zarr: data/x .* which is not read, because .* may run code; .*\.$"):
        parse(FORMAT_2, **changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"codecs": [BYTES, {"name": "pickle"}]},
        {"codecs": [BYTES, {"name": "numcodecs.pickle"}]},
        {"codecs": [{"name": "numcodecs.pickle"}, BYTES]},
        {"codecs": [BYTES, {"name": "gzip", "configuration": {"id": "pickle"}}, {"name": "pickle"}]},
        {"codecs": [BYTES, {"name": "numcodecs.delta", "configuration": {"dtype": "|O"}}]},
        {"codecs": ["bytes", "pickle"]},
        {"codecs": [{"name": "vlen-utf8"}]},
        {"codecs": [{"name": "vlen-bytes"}]},
        {"data_type": "object"},
        {"data_type": "variable_length_bytes"},
        {"data_type": {"name": "struct", "configuration": {"fields": []}}},
        {"data_type": "string", "codecs": [{"name": "vlen-utf8"}, {"name": "pickle"}]},
        sharded(codecs=[BYTES, {"name": "pickle"}]),
        sharded(codecs=sharded()["codecs"]),
        sharded(index_codecs=[BYTES, {"name": "pickle"}]),
        {"codecs": [*sharded()["codecs"], {"name": "pickle"}]},
    ],
    ids=str,
)
def test_refused_in_format_3(changes):
    with pytest.raises(DataError, match=r"^buffer.zarr: data/x .* which is not read, because .* may run code; .*\.$"):
        parse(FORMAT_3, **changes)


@pytest.mark.parametrize("name", ["imagecodecs_jpegxl", "imagecodecs_jpeg2k"])
def test_images_are_known_by_their_codec(name):
    assert parse(FORMAT_2, compressor={"id": name}).is_closed
    assert parse(FORMAT_3, codecs=[BYTES, {"name": name}]).is_closed
    assert not parse(FORMAT_2).is_closed
    assert not parse(FORMAT_3).is_closed


def test_what_a_header_says():
    header = parse(FORMAT_3, **sharded())
    assert (header.shape, header.chunks, header.shards, header.grid) == ((11, 2), (1, 2), (3, 2), (4, 1))
    assert header.file_name((3, 0)) == "c/3/0"
    assert header.coding.dtype == np.float32
    assert parse(FORMAT_2, dimension_separator="/").file_name((3, 0)) == "3/0"
    assert parse(FORMAT_2, order="F").coding.axes == (1, 0)
    text = parse(FORMAT_2, dtype="|O", filters=[{"id": "vlen-utf8"}])
    assert text.coding.is_text
    assert [codec["id"] for codec in text.coding.codecs] == ["zlib"]
    assert parse({"zarr_format": 3, "node_type": "group"}) is None


DAMAGED_2 = (
    *({"shape": shape} for shape in ("x", [-1, 2], [True, 2], [11.0, 2])),
    *({"chunks": chunks} for chunks in ([0, 2], [3], None)),
    *({"order": [0, 0]}, {"dimension_separator": "-"}, {"zarr_format": 4}, {"filters": ["zlib"]}, {"compressor": [1]}),
)
DAMAGED_3 = (
    *({"chunk_grid": {"name": "rectilinear"}}, {"chunk_key_encoding": {"name": "../.."}}, {"codecs": []}),
    {"storage_transformers": [{"name": "x"}]},
    {"codecs": [{"name": "transpose", "configuration": {"order": [0, 2]}}, BYTES]},
    *(sharded(chunk_shape=[2, 2]), sharded(chunk_shape=[1])),
)


@pytest.mark.parametrize(
    ("about", "changes"), [*((FORMAT_2, one) for one in DAMAGED_2), *((FORMAT_3, one) for one in DAMAGED_3)], ids=str
)
def test_damaged_headers(about, changes):
    with pytest.raises(DataError, match=r"^buffer.zarr: data/x: its header is damaged.*\.$"):
        parse(about, **changes)


@pytest.mark.parametrize("content", [b"", b"[" * 10**5, b"\xff", b"[]", b"{}", b'{"zarr_format": 2}', b"9" * 10**4])
def test_headers_that_are_none(content):
    with pytest.raises(DataError, match=r"header is damaged"):
        parse_header(content, "buffer.zarr: data/x")
