"""Files made to break the reader, or that declare, or decode to, far more than they hold: one sentence each, and soon.
None takes more than 1 GiB."""

import gzip
import io
import json
import shutil
import zipfile
import zlib
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.lib import format as npy

from hostile import MAX_BYTES, MAX_SECONDS, assert_refused, read_all, write_letters, write_long_list, write_zeros

h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
numcodecs = pytest.importorskip("numcodecs", reason="needs the extra zarr")

READ, OPEN, LOAD = "rpil:read", "hostile:read_on_disk", "rpil:load"
TABLE = {"episode_index": [0, 0, 1], "observation.x": [1.0, 2.0, 3.0], "action": [0, 1, 0]}
GIANT = (7 * 10**9 // 8 // 2, 2)  # of float64: 7 GB


def npz(**changes):
    arrays = {"observations": np.ones((3, 2)), "actions": np.array([0, 1, 0]), "episode_ids": np.array([0, 0, 1])}
    return lambda path: np.savez(path, **(arrays | changes))


def model(path):
    shutil.copyfile(Path(__file__).parents[1] / "golden" / "discrete_judge.rpil", path)


def giant(write, member, method=zipfile.ZIP_STORED, says=True):
    """An archive of a few kilobytes with an array of 7 GB, in a member that says so, or that is short."""

    def make(path):
        write(path)
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        head = io.BytesIO()
        npy.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": GIANT})
        with zipfile.ZipFile(path, "w", method) as archive:
            for name, content in (members | {member: head.getvalue() + bytes(1000)}).items():
                archive.writestr(name, content)
            archive.getinfo(member).file_size += (8 * GIANT[0] * GIANT[1] - 1000) * says

    return make


def twice(write, member):
    """An archive with two arrays of one name, of which readers take the last."""

    def make(path):
        write(path)
        with zipfile.ZipFile(path) as archive:
            content = archive.read(member)
        with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr(member, content)

    return make


def parquet(**changes):
    return lambda path: pq.write_table(pa.table(TABLE | changes), path)


def constants(path):
    """Twenty million rows in a few kilobytes."""
    n = 1_000_000
    block = pa.table({"episode_index": np.zeros(n, int), "observation.x": np.ones(n), "action": np.zeros(n, int)})
    with pq.ParquetWriter(path, block.schema, compression="zstd") as writer:
        for _ in range(20):
            writer.write_table(block)
    assert path.stat().st_size < 1e6


def long_parquet_id(path):
    """One id of a million characters, in 50,000 rows: 50 GB where every row has its own copy."""
    n = 50_000
    ids = pa.DictionaryArray.from_arrays(np.zeros(n, np.int32), ["x" * 1_000_000])
    pq.write_table(pa.table({"episode_index": ids, "observation.x": np.ones(n), "action": np.zeros(n, int)}), path)


def long_csv_id(path):
    rows = "".join(f"{'x' * 1_000_000 if row == 9 else 'a'},{row},0\n" for row in range(20_000))
    path.write_text("episode_index,observation.x,action\n" + rows)


FILES = {
    "giant-observations.npz": (giant(npz(), "observations.npy", zipfile.ZIP_DEFLATED), READ),
    "giant-names.npz": (giant(npz(), "observation_names.npy", zipfile.ZIP_DEFLATED), READ),
    "giant-weights.rpil": (giant(model, "policy/weights.npy"), LOAD),
    "short.npz": (giant(npz(), "observation_names.npy", says=False), READ),
    "twice.npz": (twice(npz(), "observations.npy"), READ),
    "twice.rpil": (twice(model, "policy/weights.npy"), LOAD),
    "constants.parquet": (constants, READ),
    "long-id.csv": (long_csv_id, READ),
    "long-id.parquet": (long_parquet_id, READ),
    "code-point-of-action.npz": (npz(actions=np.array([0x110000, 97, 98], dtype=np.uint32).view("U1")), READ),
    "trailing-nul.parquet": (parquet(episode_index=["a", "a\0", "a\0"]), READ),
    "empty-id.parquet": (parquet(episode_index=["", "", "b"]), READ),
    "large-id.parquet": (parquet(episode_index=np.array([2**63, 2**63, 1], np.uint64)), READ),
    "lists-of-ids-on-disk.parquet": (parquet(episode_index=[[0, 1], [0, 1], [1, 2]]), OPEN),
    "digits-as-key.json": (
        lambda path: path.write_text(json.dumps({"9" * 5000: 3})),
        "rpil.data.id_values:read_answer_rows",
    ),
}
BOTH = ("long-id", "trailing-nul", "empty-id", "large-id")
"""Files that are read into memory and left on disk."""
FILES |= {f"{name}-on-disk.parquet": (FILES[f"{name}.parquet"][0], OPEN) for name in BOTH}

ZEROS = 15 * 10**8


def zeros(window=15):
    """A gigabyte and a half of zeros, by deflate; of the same piece again and again, without a valid checksum."""
    packer = zlib.compressobj(1, zlib.DEFLATED, window)
    first, piece = (packer.compress(bytes(10**7)) + packer.flush(zlib.Z_FULL_FLUSH) for _ in range(2))
    return first + (ZEROS // 10**7 - 1) * piece + packer.flush()


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
    content = zeros(31)
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
        arrays = {"observations": np.ones((36, 3)), "actions": np.ones((36, 2))}
        arrays["terminals"] = np.isin(np.arange(36), [17, 35])
        with h5py.File(path, "w") as file:
            for name, values in arrays.items():
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


SIZES = {
    "gzip.zarr": (zarr_store(action=lambda: zeros(31), compressor={"id": "gzip", "level": 1}), READ),
    "gzip-ends.zarr": (zarr_store(ends=lambda: zeros(31)), READ),
    "gzip-3.zarr": (zarr_3, READ),
    "blosc.zarr": (
        zarr_store(action=lambda: numcodecs.Blosc().encode(np.zeros(ZEROS, np.uint8)), compressor={"id": "blosc"}),
        READ,
    ),
    "no-chunk.zarr": (zarr_store(shape=[40, 4 * 10**6], chunks=[1, 1]), READ),
    "wide-chunk.zarr": (zarr_store(chunks=[10**9, 3], action=lambda: zeros(31), compressor={"id": "gzip"}), READ),
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
    "long-list-hidden.parquet": (lambda path: write_long_list(path, 10**7, says=2), READ),
    "letters.parquet": (lambda path: write_letters(path, 12 * 10**7), READ),
    "zeros-hidden.parquet": (lambda path: write_zeros(path, 15 * 10**6, says=2), READ),
    "lists.json": (labels, "rpil.data.id_values:read_answer_rows"),
}


MEMORY = "300MB"
CORPORA = {MEMORY: FILES, None: SIZES}
"""The files by the memory that data may take, None for what the library allows."""

CASES = [
    pytest.param(memory, name, marks=[] if memory else pytest.mark.slow)
    for memory in CORPORA
    for name in CORPORA[memory]
]


@pytest.fixture(scope="module")
def ends(tmp_path_factory):
    return cache(lambda memory: read_all(tmp_path_factory.mktemp("hostile"), CORPORA[memory], memory))


@pytest.mark.parametrize(("memory", "name"), CASES)
def test_it_is_refused_in_one_sentence_and_soon(ends, memory, name):
    assert_refused(ends(memory)[0][name], name)
    assert float(ends(memory)[0][name][2]) < MAX_SECONDS


@pytest.mark.parametrize("memory", [MEMORY, pytest.param(None, marks=pytest.mark.slow)])
def test_no_file_takes_more_than_one_gib(ends, memory):
    assert ends(memory)[1] < MAX_BYTES


def test_the_figures_are_named(ends):
    found = ends(MEMORY)[0]
    for name, size in (("giant-names.npz", "14.0 GB"), ("constants.parquet", "1.0 GB")):
        assert f"would take {size} of memory, more than the 0.3 GB that it may" in found[name][1]
    assert "twice.npz: it holds two arrays of one name" in found["twice.npz"][1]
    assert "more than the file" in found["giant-weights.rpil"][1]
