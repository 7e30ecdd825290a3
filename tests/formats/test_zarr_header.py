"""Codecs and types that are not on the list are refused before any library is asked for them."""

import json
import sys
from pathlib import Path

import pytest

import rpil
from rpil.data.errors import DataError
from rpil.formats.registry import find
from rpil.formats.zarr import _array, _header, check_header, has_images

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


def check(about, **changes):
    check_header(about | changes, "buffer.zarr: data/x")


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
        find(path).keep(tmp_path / "ids.json", [0])
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
        check(FORMAT_2, **changes)


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
        {"codecs": [BYTES, {"name": "numcodecs.gzip", "configuration": {"id": "pickle"}}]},
        sharded(index_codecs=[BYTES, {"name": "pickle"}]),
        {"codecs": [*sharded()["codecs"], {"name": "pickle"}]},
    ],
    ids=str,
)
def test_refused_in_format_3(changes):
    with pytest.raises(DataError, match=r"^buffer.zarr: data/x .* which is not read, because .* may run code; .*\.$"):
        check(FORMAT_3, **changes)


@pytest.mark.parametrize("name", ["imagecodecs_jpegxl", "imagecodecs_jpeg2k"])
def test_images_are_known_by_their_codec(name):
    for about, changes in ((FORMAT_2, {"compressor": {"id": name}}), (FORMAT_3, {"codecs": [BYTES, {"name": name}]})):
        check(about, **changes)
        assert has_images(about | changes)
        assert not has_images(about)


DAMAGED_2 = (
    *({"shape": shape} for shape in ("x", [-1, 2], [11.5, 2])),
    *({"chunks": chunks} for chunks in ([0, 2], [3], None)),
    *({"dimension_separator": "-"}, {"zarr_format": 4}, {"filters": ["zlib"]}, {"compressor": [1]}, {"order": [0, 0]}),
)
DAMAGED_3 = (
    *({"chunk_grid": {"name": "rectilinear"}}, {"chunk_key_encoding": {"name": "../.."}}, {"codecs": []}),
    {"storage_transformers": [{"name": "x"}]},
    {"codecs": [{"name": "transpose", "configuration": {"order": [0, 2]}}, BYTES]},
    *(sharded(chunk_shape=[2, 2]), sharded(chunk_shape=[1])),
)
DAMAGED = [*((".zarray", FORMAT_2 | one) for one in DAMAGED_2), *(("zarr.json", FORMAT_3 | one) for one in DAMAGED_3)]
NO_JSON = [(".zarray", text) for text in ("", "[" * 10**5, "\xff", "[]", "{}", '{"zarr_format": 2}', "9" * 10**4)]


@pytest.mark.parametrize(("file", "content"), [*DAMAGED, *NO_JSON], ids=lambda part: str(part)[:40])
def test_damaged_headers(tmp_path, file, content):
    pytest.importorskip("zarr", minversion="3")
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / file).write_text(content if isinstance(content, str) else json.dumps(content), "latin-1")
    with pytest.raises(DataError, match=r"^[\w]+: x: its header is damaged, .*\.$"):
        _array(tmp_path, tmp_path, "x", _header(tmp_path, "x", tmp_path.name))
