"""Codecs and types that are not on the list are refused, and nothing is decoded with them."""

import json
from pathlib import Path

import numpy as np
import pytest

import rpil
from rpil.data.errors import DataError
from rpil.formats.registry import find

zarr = pytest.importorskip("zarr", minversion="3", reason="needs the extra zarr")
numcodecs = pytest.importorskip("numcodecs")

BYTES = {"name": "bytes", "configuration": {"endian": "little"}}
PICKLE = {"id": "pickle"}
TEXT = {"dtype": "|O", "fill_value": ""}


@pytest.mark.parametrize("disguise", ["x.zarr", "x.zarr.zip", "x.npz", "x.csv"])
@pytest.mark.parametrize("place", ["ends-filter", "ends-compressor", "data-filter"])
def test_a_store_that_runs_code_decodes_nothing(tmp_path, monkeypatch, place, disguise):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "tools"))
    import hostile_zarr

    hostile_zarr.write_store(tmp_path / "store", place, tmp_path / "marker")
    path = tmp_path / disguise
    hostile_zarr.disguise(tmp_path / "store", path)
    monkeypatch.setattr(numcodecs.pickles, "ALLOW_UNSAFE_PICKLE_DECODE", True)  # as before numcodecs 0.16.6
    with pytest.raises(DataError, match="'pickle'" if ".zarr" in disguise else disguise):
        rpil.read(path)
    with pytest.raises(DataError):
        find(path).keep(tmp_path / "ids.json", [0])
    assert not (tmp_path / "marker").exists()


def sharded(**changes):
    inner = {"chunk_shape": [1, 2], "codecs": [BYTES], "index_codecs": [BYTES, {"name": "crc32c"}]}
    return {"codecs": [{"name": "sharding_indexed", "configuration": inner | changes}]}


def read(folder, zarr_format, change):
    """Read a store whose header of its actions has a change, or is a text."""
    root = zarr.create_group(folder, zarr_format=zarr_format)
    root.create_array("data/state", data=np.ones((11, 1)))
    root.create_array("data/action", data=np.ones((11, 2), np.float32), chunks=(3, 2))
    root.create_array("meta/episode_ends", data=np.array([4, 11]))
    header = folder / "data/action" / (".zarray" if zarr_format == 2 else "zarr.json")
    content = change if isinstance(change, str) else json.dumps(json.loads(header.read_text()) | change)
    header.write_text(content, "latin-1")
    rpil.read(folder)


REFUSED = [
    *({"compressor": codec} for codec in (PICKLE, {"id": "lzma"}, {"id": ["pickle"]})),
    *({"filters": [{"id": name}]} for name in ("pickle", "json2", "vlen-utf8", "vlen-bytes")),
    TEXT | {"filters": [{"id": "vlen-utf8"}, PICKLE]},
    TEXT | {"filters": [{"id": "vlen-utf8"}], "compressor": PICKLE},
    *({"dtype": dtype} for dtype in ("|O", "O", "f8,O", "|V8", [["a", "<f4"]])),
    {"filters": [{"id": "fixedscaleoffset", "dtype": "<f4", "astype": "|O", "scale": 1, "offset": 0}]},
]
REFUSED_3 = [
    *({"codecs": [BYTES, {"name": name}]} for name in ("pickle", "numcodecs.pickle", "numcodecs.lzma")),
    *({"codecs": codecs} for codecs in (["bytes", "pickle"], [{"name": "vlen-bytes"}], [])),
    *({"data_type": kind} for kind in ("object", "variable_length_bytes", {"name": "struct", "configuration": {}})),
    sharded(codecs=[BYTES, {"name": "pickle"}]),
    sharded(index_codecs=[BYTES, {"name": "pickle"}]),
    {"codecs": [*sharded()["codecs"], {"name": "pickle"}]},
]
DAMAGED = [
    *({"shape": shape} for shape in ("x", [-1, 2], [11.5, 2])),
    *({"chunks": chunks} for chunks in ([0, 2], [3], None)),
    *({"dimension_separator": "-"}, {"zarr_format": 4}, {"filters": ["zlib"]}, {"compressor": [1]}, {"order": [0, 0]}),
]
DAMAGED_3 = [
    *({"chunk_grid": {"name": "rectilinear"}}, {"chunk_key_encoding": {"name": "../.."}}),
    {"storage_transformers": [{"name": "x"}]},
    *(sharded(chunk_shape=[2, 2]), sharded(chunk_shape=[1])),
]
HEADERS = [
    *((2, one) for one in (*REFUSED, *DAMAGED, "", "[" * 10**5, "\xff", "[]", "{}", '{"zarr_format": 2}', "9" * 10**4)),
    *((3, one) for one in (*REFUSED_3, *DAMAGED_3)),
]


@pytest.mark.parametrize(("zarr_format", "change"), HEADERS, ids=lambda part: str(part)[-60:])
def test_other_headers_are_refused_in_a_sentence_that_names_the_array(tmp_path, zarr_format, change):
    with pytest.raises(DataError, match=r"^x: data/action.* (its header is damaged, |may run code; ).*\.$"):
        read(tmp_path / "x", zarr_format, change)
