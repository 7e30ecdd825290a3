"""Files that declare, or decode to, far more than they hold, or run in circles: refused under 1 GiB and 10 s."""

from __future__ import annotations

import gzip
import json
import zipfile
import zlib

import numpy as np
import pytest

from hostile import (
    MAX_BYTES,
    MAX_SECONDS,
    assert_refused,
    read_all,
    write_letters,
    write_long_list,
    write_zeros,
)

h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
numcodecs = pytest.importorskip("numcodecs", reason="needs the extra zarr")
pytestmark = pytest.mark.slow

READ, OPEN = "rpil:read", "hostile:read_on_disk"
GIANT = 15 * 10**8


def zeros(window=15):
    """A gigabyte and a half of zeros, by deflate; of the same piece again and again, without a valid checksum."""
    packer = zlib.compressobj(1, zlib.DEFLATED, window)
    first, piece = (packer.compress(bytes(10**7)) + packer.flush(zlib.Z_FULL_FLUSH) for _ in range(2))
    return first + (GIANT // 10**7 - 1) * piece + packer.flush()


def gzipped():
    return zeros(31)


def zarr_store(ends=b"", action=b"", **changes):
    """A store of 40 steps in format 2, its bytes as given, and the header of its actions changed."""
    arrays = {
        "meta/episode_ends": ({"shape": [2], "chunks": [2], "dtype": "<i8"}, ends or np.array([20, 40]).tobytes()),
        "data/state": ({"shape": [40, 3], "chunks": [40, 3], "dtype": "<f8"}, bytes(960)),
        "data/action": ({"shape": [40, 3], "chunks": [40, 3], "dtype": "<f8"} | changes, action),
    }

    def make(path):
        for name, (about, content) in arrays.items():
            (path / name).mkdir(parents=True)
            plain = {"zarr_format": 2, "compressor": None, "filters": None, "fill_value": 0, "order": "C"}
            packed = {"compressor": {"id": "gzip", "level": 1}} if name == "meta/episode_ends" and ends else {}
            (path / name / ".zarray").write_text(json.dumps(plain | about | packed))
            content = content() if callable(content) else content
            if content:
                (path / name / ("0" if len(about["shape"]) == 1 else "0.0")).write_bytes(content)

    return make


def encoded(codec):
    return lambda: codec.encode(np.zeros(GIANT, np.uint8))


def zarr_3(path):
    """Eight chunks of more than a gigabyte in format 3."""
    zarr_store()(path)
    (path / "data/action/.zarray").unlink()
    about = {
        "zarr_format": 3,
        "node_type": "array",
        "shape": [40, 3],
        "data_type": "float64",
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [5, 3]}},
        "chunk_key_encoding": {"name": "default"},
        "fill_value": 0,
        "codecs": [
            {"name": "bytes", "configuration": {"endian": "little"}},
            {"name": "gzip", "configuration": {"level": 1}},
        ],
    }
    (path / "data/action/zarr.json").write_text(json.dumps(about))
    content = gzipped()
    for k in range(8):
        (path / f"data/action/c/{k}").mkdir(parents=True)
        (path / f"data/action/c/{k}/0").write_bytes(content)


def zipped_zarr(path):
    """A chunk that is an honest one in a member of a ZIP file that is not."""
    folder = path.parent / "of-zip"
    zarr_store()(folder)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for file in sorted(file for file in folder.rglob("*") if file.is_file()):
            archive.write(file, file.relative_to(folder))
        with archive.open("data/action/0.0", "w", force_zip64=True) as member:
            for _ in range(20):
                member.write(bytes(10**7))


def robomimic(write):
    def make(path):
        with h5py.File(path, "w") as file:
            for k in range(2):
                file[f"data/demo_{k}/obs/x"] = np.ones((10, 3))
                file[f"data/demo_{k}/actions"] = np.ones((10, 3))
            del file["data/demo_0/actions"]
            write(file)

    return make


def huge(file):
    del file["data/demo_0/obs/x"]
    for name in ("obs/x", "actions"):
        file.create_dataset(f"data/demo_0/{name}", (2**50, 3), "f8", chunks=(1000, 3))


def actions(kind):
    return robomimic(lambda file: file.create_dataset("data/demo_0/actions", (10,), kind))


def flat(**sizes):
    """Two demonstrations as D4RL keeps them, of which some arrays declare other sizes."""

    def make(path):
        with h5py.File(path, "w") as file:
            ends = np.isin(np.arange(36), [17, 35])
            for name, values in {
                "observations": np.ones((36, 3)),
                "actions": np.ones((36, 2)),
                "terminals": ends,
            }.items():
                if name in sizes:
                    file.create_dataset(name, sizes[name], values.dtype, chunks=(36, 2))
                else:
                    file[name] = values

    return make


def huge_mask(file):
    file["data/demo_0/actions"] = np.ones((10, 3))
    file.create_dataset("mask/huge", (3 * 10**8,), "S8")


def lists(n):
    yield b'{"schema": "rpil fitted estimator", "x": ['
    for _ in range(n // 10**6 - 1):
        yield b"[]," * 10**6
    yield b"[]]}"


def labels(path):
    with path.open("wb") as file:
        for piece in lists(21 * 10**6):
            file.write(piece)


def no_chunk_of_many_rows(path):
    one_value = {"shape": [10**7, 1], "chunks": [1, 1], "dtype": "<f8"}
    zarr_store(ends=gzip.compress(np.array([5 * 10**6, 10**7]).tobytes()), **one_value)(path)
    header = path / "data/state/.zarray"
    header.write_text(json.dumps(json.loads(header.read_text()) | one_value))
    (path / "data/state/0.0").unlink()


def wide_texts(path):
    zarr_store(action=bytes(960))(path)
    (path / "data/task").mkdir()
    about = json.loads((path / "data/action/.zarray").read_text())
    about |= {"shape": [40], "chunks": [1], "dtype": "<U999999", "compressor": {"id": "zstd"}}
    (path / "data/task/.zarray").write_text(json.dumps(about))
    for k in range(40):
        (path / f"data/task/{k}").write_bytes(numcodecs.Zstd().encode(bytes(4 * 999_999)))


def same_as(name):
    """A file that was made before."""
    return lambda path: path.hardlink_to(path.with_name(name))


FILES = {
    "gzip.zarr": (zarr_store(action=gzipped, compressor={"id": "gzip", "level": 1}), READ),
    "gzip-ends.zarr": (zarr_store(ends=gzipped), READ),
    "gzip-3.zarr": (zarr_3, READ),
    "blosc.zarr": (zarr_store(action=encoded(numcodecs.Blosc()), compressor={"id": "blosc"}), READ),
    "no-chunk.zarr": (zarr_store(shape=[40, 4 * 10**6], chunks=[1, 1]), READ),
    "wide-chunk.zarr": (zarr_store(chunks=[10**9, 3], action=gzipped, compressor={"id": "gzip"}), READ),
    "many-rows.zarr": (no_chunk_of_many_rows, READ),
    "wide-texts.zarr": (wide_texts, READ),
    "deflated.zarr.zip": (zipped_zarr, READ),
    "huge.hdf5": (robomimic(huge), READ),
    "objects.hdf5": (actions(h5py.vlen_dtype(np.float64)), READ),
    "references.hdf5": (actions(h5py.ref_dtype), READ),
    "compound.hdf5": (actions(np.dtype([("a", "f8"), ("b", "S4")])), READ),
    "empty.hdf5": (lambda path: h5py.File(path, "w").close(), READ),
    "huge-actions.hdf5": (flat(actions=(2**40, 2)), READ),
    "huge-ends.hdf5": (flat(terminals=(36, 2**30)), READ),
    "huge-mask.hdf5": (robomimic(huge_mask), "hostile:keep_first"),
    "long-list.parquet": (lambda path: write_long_list(path, 10**7), READ),
    "long-list-on-disk.parquet": (same_as("long-list.parquet"), OPEN),
    "long-list-hidden.parquet": (lambda path: write_long_list(path, 10**7, says=2), READ),
    "letters.parquet": (lambda path: write_letters(path, 12 * 10**7), READ),
    "verdicts.parquet": (lambda path: write_letters(path, 12 * 10**7), "rpil.results.choice:read_verdicts"),
    "zeros-hidden.parquet": (lambda path: write_zeros(path, 15 * 10**6, says=2), READ),
    "zeros-hidden-on-disk.parquet": (same_as("zeros-hidden.parquet"), OPEN),
    "lists.json": (labels, "rpil.formats:read_labels"),
}


@pytest.fixture(scope="module")
def ends(tmp_path_factory):
    return read_all(tmp_path_factory.mktemp("sizes"), FILES, memory=None)


@pytest.mark.parametrize("name", FILES)
def test_it_is_refused_in_one_sentence_and_soon(ends, name):
    assert_refused(ends[0][name], name)
    assert float(ends[0][name][2]) < MAX_SECONDS


def test_no_file_takes_more_than_one_gib(ends):
    assert ends[1] < MAX_BYTES
