"""Files made to break the reader: each is refused in one sentence, and none takes more than 1 GiB."""

from __future__ import annotations

import io
import json
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.lib import format as npy

from archives import npy as to_npy
from archives import rewrite
from hostile import MAX_BYTES, assert_refused, read_all

READ, OPEN, LOAD = "rpil:read", "hostile:read_on_disk", "rpil:load"
MODEL = Path(__file__).parents[1] / "golden" / "discrete_judge.rpil"
TABLE = {"episode_index": [0, 0, 1], "observation.x": [1.0, 2.0, 3.0], "action": [0, 1, 0]}
NOT_UNICODE = np.array([0x110000, 97, 98], dtype=np.uint32).view("U1")
GIANT = (7 * 10**9 // 8 // 2, 2)  # of float64: 7 GB


def npz(**changes):
    arrays = {"observations": np.ones((3, 2)), "actions": np.array([0, 1, 0]), "episode_ids": np.array([0, 0, 1])}
    return lambda path: np.savez(path, **(arrays | changes))


def model(path):
    shutil.copyfile(MODEL, path)


def resized(member, shape):
    def make(path):
        model(path)
        rewrite(path, {member: to_npy(np.ones(shape))})

    return make


def giant(write, member, method=zipfile.ZIP_STORED):
    """An archive of a few kilobytes with a member that says that it holds 7 GB."""

    def make(path):
        write(path)
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        head = io.BytesIO()
        npy.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": GIANT})
        with zipfile.ZipFile(path, "w", method) as archive:
            for name, content in (members | {member: head.getvalue() + bytes(1000)}).items():
                archive.writestr(name, content)
            archive.getinfo(member).file_size = len(head.getvalue()) + 8 * GIANT[0] * GIANT[1]

    return make


def short_npz(path):
    """An archive with an array of 7 GB of which only a kilobyte is there."""
    npz()(path)
    with zipfile.ZipFile(path, "a") as archive:
        head = io.BytesIO()
        npy.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": GIANT})
        archive.writestr("observation_names.npy", head.getvalue() + bytes(1000))


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


def text(content):
    return lambda path: path.write_text(content)


FILES = {
    "giant-observations.npz": (giant(npz(), "observations.npy", zipfile.ZIP_DEFLATED), READ),
    "giant-names.npz": (giant(npz(), "observation_names.npy", zipfile.ZIP_DEFLATED), READ),
    "giant-weights.rpil": (giant(model, "policy/weights.npy"), LOAD),
    "short.npz": (short_npz, READ),
    "twice.npz": (twice(npz(), "observations.npy"), READ),
    **{
        f"{part.partition('/')[2]}-{len(shape)}.rpil": (resized(f"{part}.npy", shape), LOAD)
        for part in ("features/folds", "features/spread", "features/scale", "policy/ridge")
        for shape in ((), (1,))
    },
    "twice.rpil": (twice(model, "policy/weights.npy"), LOAD),
    "constants.parquet": (constants, READ),
    "long-id.csv": (long_csv_id, READ),
    "long-id.parquet": (long_parquet_id, READ),
    "code-point-of-action.npz": (npz(actions=NOT_UNICODE), READ),
    "trailing-nul.parquet": (parquet(episode_index=["a", "a\0", "a\0"]), READ),
    "empty-id.parquet": (parquet(episode_index=["", "", "b"]), READ),
    "large-id.parquet": (parquet(episode_index=np.array([2**63, 2**63, 1], np.uint64)), READ),
    "lists-of-ids-on-disk.parquet": (parquet(episode_index=[[0, 1], [0, 1], [1, 2]]), OPEN),
    "digits-as-key.json": (text(json.dumps({"9" * 5000: 3})), "rpil.formats:read_labels"),
}
BOTH = ("long-id", "trailing-nul", "empty-id", "large-id")
"""Files that are read into memory and left on disk."""
FILES |= {f"{name}-on-disk.parquet": (FILES[f"{name}.parquet"][0], OPEN) for name in BOTH}


@pytest.fixture(scope="module")
def ends(tmp_path_factory):
    return read_all(tmp_path_factory.mktemp("hostile"), FILES)


@pytest.mark.parametrize("name", FILES)
def test_it_is_refused_in_one_sentence(ends, name):
    assert_refused(ends[0][name], name)


def test_the_figures_are_named(ends):
    for name, size in (("giant-names.npz", "14.0 GB"), ("constants.parquet", "1.0 GB")):
        assert f"would take {size} of memory, more than the 0.3 GB that it may" in ends[0][name][1]
    assert "twice.npz: it holds two arrays of one name" in ends[0]["twice.npz"][1]
    assert "more than the file" in ends[0]["giant-weights.rpil"][1]


def test_no_file_takes_more_than_one_gib(ends):
    assert ends[1] < MAX_BYTES
