"""Arrays of every codec, type, order of axes and layout of files are read, and chunks that are missing are found."""

import json
import shutil

import numpy as np
import pytest

from rpil.data.errors import DataError
from rpil.formats.zarr_array import Store, ZarrArray

zarr = pytest.importorskip("zarr", minversion="3", reason="needs the extra zarr")
numcodecs = pytest.importorskip("numcodecs")
codecs = pytest.importorskip("zarr.codecs")

VALUES = np.random.default_rng(0).normal(size=(11, 5, 2)).cumsum(axis=0)
WORDS = np.array(["lift", "", "gieße Kaffee", "stop"] * 3)[:11]


def opened_array(folder, fills=False):
    """The array in a folder, which is the whole store."""
    store = Store(folder.parent, folder.parent)
    return ZarrArray(store, folder.name, store.headers([folder.name])[folder.name], np.array([4, 9, 11]), fills)


def write(folder, values=VALUES, zarr_format=2, **how):
    how = {"chunks": (3, 2, *values.shape[2:])[: values.ndim]} | how
    with zarr.config.set({"array.write_empty_chunks": True}):
        array = zarr.create_array(
            str(folder), shape=values.shape, dtype=values.dtype, zarr_format=zarr_format, overwrite=True, **how
        )
        array[...] = values
    return opened_array(folder)


@pytest.mark.parametrize(
    "codec",
    [
        None,
        numcodecs.Blosc("lz4", shuffle=2),
        numcodecs.Blosc("zstd"),
        numcodecs.Zlib(),
        numcodecs.GZip(),
        numcodecs.Zstd(),
        numcodecs.LZ4(),
        numcodecs.BZ2(),
    ],
    ids=lambda codec: codec.codec_id if codec else "none",
)
@pytest.mark.parametrize("order", ["C", "F"])
def test_codecs_of_format_2(tmp_path, codec, order):
    found = write(tmp_path / "x", compressors=codec, order=order)
    np.testing.assert_array_equal(found[0:11], VALUES)
    np.testing.assert_array_equal(found.take(np.array([0, 1, 7, 10])), VALUES[[0, 1, 7, 10]])


@pytest.mark.parametrize(
    "codec",
    [
        numcodecs.Delta("<f8"),
        numcodecs.FixedScaleOffset(0, 1e12, "<f8", "<i8"),
        numcodecs.Shuffle(8),
        numcodecs.CRC32(),
    ],
    ids=lambda codec: codec.codec_id,
)
def test_filters_of_format_2(tmp_path, codec):
    found = write(tmp_path / "x", filters=[codec], compressors=numcodecs.Zlib())
    np.testing.assert_array_equal(found[0:11], zarr.open_array(str(tmp_path / "x"))[...])
    np.testing.assert_allclose(found[0:11], VALUES, atol=1e-9)


@pytest.mark.parametrize(
    "how",
    [
        {"compressors": None},
        {"compressors": [codecs.GzipCodec()]},
        {"compressors": [codecs.ZstdCodec(), codecs.Crc32cCodec()]},
        {"compressors": [codecs.BloscCodec(cname="zstd")]},
        {"filters": [codecs.TransposeCodec(order=(2, 0, 1))]},
        {"serializer": codecs.BytesCodec(endian="big")},
        {"shards": (6, 4, 2)},
        {
            "shards": (6, 4, 2),
            "compressors": [codecs.BloscCodec()],
            "filters": [codecs.TransposeCodec(order=(1, 0, 2))],
        },
        {"chunk_key_encoding": {"name": "default", "separator": "."}},
        {"chunk_key_encoding": {"name": "v2", "separator": "/"}},
    ],
    ids=lambda how: "-".join(how),
)
def test_codecs_and_names_of_format_3(tmp_path, how):
    found = write(tmp_path / "x", zarr_format=3, **how)
    np.testing.assert_array_equal(found[0:11], VALUES)
    np.testing.assert_array_equal(found[4:9], VALUES[4:9])


def test_index_of_a_shard_at_its_start_and_chunks_left_out_of_it(tmp_path):
    values = VALUES.copy()
    values[:3] = 7
    codec = codecs.ShardingCodec(chunk_shape=(3, 5, 2), index_location="start")
    zarr.create_array(
        str(tmp_path / "x"),
        shape=values.shape,
        dtype=float,
        chunks=(6, 5, 2),
        serializer=codec,
        compressors=None,
        fill_value=7.0,
    )[...] = values
    np.testing.assert_array_equal(opened_array(tmp_path / "x")[0:11], values)


@pytest.mark.parametrize("zarr_format", [2, 3])
@pytest.mark.parametrize(
    "values",
    [
        *(VALUES.astype(kind) for kind in ("f2", "f4", "i1", "u2", "i8", "c16", "?")),
        VALUES.astype(">f4"),
        WORDS,
        WORDS.astype(np.dtypes.StringDType()),
        np.array([b"lift", b"", b"stop"] * 3),
        np.arange("2024-01-01", "2024-01-09", dtype="M8[D]"),
    ],
    ids=lambda values: str(values.dtype),
)
@pytest.mark.filterwarnings("ignore")
def test_types(tmp_path, values, zarr_format):
    found = write(tmp_path / "x", values, zarr_format)
    assert found.dtype.kind == values.dtype.kind
    np.testing.assert_array_equal(found[0 : len(values)], values)


@pytest.mark.parametrize("dtype", ["|O", "<U12"])
@pytest.mark.parametrize("codec", [numcodecs.VLenUTF8(), numcodecs.VLenBytes()], ids=lambda codec: codec.codec_id)
def test_texts_of_any_length(tmp_path, codec, dtype):
    header = {"zarr_format": 2, "shape": [11], "chunks": [11], "dtype": dtype, "filters": [codec.get_config()]}
    header |= {"compressor": {"id": "zlib"}, "fill_value": None, "order": "C"}
    words = np.array([word.encode() if codec.codec_id == "vlen-bytes" else word for word in WORDS.tolist()], object)
    (tmp_path / "x").mkdir()
    (tmp_path / "x/.zarray").write_text(json.dumps(header))
    (tmp_path / "x/0").write_bytes(numcodecs.Zlib().encode(codec.encode(words)))
    found = opened_array(tmp_path / "x")
    assert found.dtype.kind in "TU"
    assert found[2:9].tolist() == words[2:9].tolist()
    (tmp_path / "x/.zarray").write_text(json.dumps(header | {"fill_value": 0}))
    (tmp_path / "x/0").unlink()
    assert not any(opened_array(tmp_path / "x", fills=True)[2:9].tolist())


@pytest.mark.parametrize("separator", [".", "/"])
@pytest.mark.parametrize(("zarr_format", "shards"), [(2, None), (3, None), (3, (3, 5, 2))])
def test_a_chunk_that_is_not_there(tmp_path, separator, zarr_format, shards):
    key = {"name": "v2" if zarr_format == 2 else "default", "separator": separator}
    size = (3, 5, 1) if shards else (3, 5, 2)
    how = {"chunks": size, "shards": shards, "chunk_key_encoding": key}
    found = write(tmp_path / "x", zarr_format=zarr_format, fill_value=7.0, **how)
    (tmp_path / found.chunk_file((1, 0, 0))).unlink()
    found = opened_array(tmp_path / "x")
    np.testing.assert_array_equal(found[0:3], VALUES[:3])
    with pytest.raises(DataError, match=r"1 of its 4 chunks .* demonstrations 0, 1, .*write_empty_chunks"):
        found[0:4]
    filled = opened_array(tmp_path / "x", fills=True)[0:11]
    assert (filled[3:6] == 7).all()
    np.testing.assert_array_equal(filled[6:], VALUES[6:])


@pytest.mark.parametrize(("fill", "value"), [("NaN", np.nan), ("-Infinity", -np.inf), (None, 0), (1, 1)])
def test_fill_values(tmp_path, fill, value):
    write(tmp_path / "x")
    header = tmp_path / "x/.zarray"
    header.write_text(json.dumps({**json.loads(header.read_text()), "fill_value": fill}))
    shutil.move(header, tmp_path / "header")
    shutil.rmtree(tmp_path / "x")
    (tmp_path / "x").mkdir()
    shutil.move(tmp_path / "header", header)
    np.testing.assert_array_equal(opened_array(tmp_path / "x", fills=True)[0:2], np.full((2, 5, 2), value))


@pytest.mark.parametrize("codec", [None, numcodecs.Zlib(), numcodecs.Blosc(), numcodecs.LZ4(), numcodecs.Zstd()])
@pytest.mark.parametrize("size", [959, 961, 10**6])
def test_a_chunk_of_another_size_is_refused(tmp_path, codec, size):
    found = write(tmp_path / "x", chunks=(12, 5, 2), compressors=codec)
    (tmp_path / "x/0.0.0").write_bytes(codec.encode(bytes(size)) if codec else bytes(size))
    with pytest.raises(DataError, match=r"x: a chunk of it is damaged.* again\.$"):
        found[0:1]
