"""Damage of many kinds, to data of every layout: reading and keeping end in one sentence that names the file."""

import itertools
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import rpil
from command_line import refused
from rpil.data.errors import DataError
from rpil.formats.registry import find
from samples import SAMPLES

DEEP = "[" * 100_000
INFO, STATS, EPISODES, STEPS = (
    "meta/info.json",
    "meta/stats.json",
    "meta/episodes/chunk-000/file-000.parquet",
    "data/chunk-000/file-000.parquet",
)


def sample(name):
    path = SAMPLES[name](Path())
    assert len(rpil.read(path)) > 1
    return path


@pytest.mark.parametrize("n_batches", [0, 1])
def test_row_groups_without_all_their_rows(monkeypatch, n_batches):
    """A damaged footer can tell of more rows than its pages hold."""
    path = sample("Parquet")
    read = pq.ParquetFile.iter_batches

    def iter_batches(self, size, **options):
        return itertools.islice(read(self, size, **options), n_batches if size == 4 else None)

    monkeypatch.setattr(pq.ParquetFile, "iter_batches", iter_batches)
    monkeypatch.setattr("rpil.formats.parquet.BATCH_ROWS", 4)
    with pytest.raises(DataError, match=r"^g\.parquet: .*damaged.*of 15 rows"):
        rpil.open(path, on_disk=True)
    if n_batches == 0:
        refused(re.escape(path.name), "info", path, "--memory", "1kB")


def drop_numbers(path):
    pq.write_table(pq.read_table(path / EPISODES).drop_columns("episode_index"), path / EPISODES)


def damage_page(path):
    content = bytearray((path / STEPS).read_bytes())
    content[4:200] = b"\xff" * 196
    (path / STEPS).write_bytes(content)


LEROBOT = {
    "chunks_size endless": (
        lambda path: (path / INFO).write_text((path / INFO).read_text().replace("1000", "1e400")),
        INFO,
    ),
    "statistics nested deeply": (lambda path: (path / STATS).write_text(DEEP), STATS),
    "info nested deeply": (lambda path: (path / INFO).write_text(DEEP), INFO),
    "episodes missing": (lambda path: shutil.rmtree(path / "meta/episodes"), "episode"),
    "episodes without numbers": (drop_numbers, "episode"),
    "episodes damaged": (lambda path: (path / EPISODES).write_bytes(b"PAR1"), "episode"),
    "data no Parquet": (lambda path: (path / STEPS).write_bytes(b"no"), "file-000.parquet"),
    "data damaged": (damage_page, "file-000.parquet"),
}


@pytest.mark.parametrize("damage", LEROBOT)
def test_damaged_lerobot_is_not_kept(damage):
    path = sample("LeRobot")
    LEROBOT[damage][0](path)
    Path("labels.csv").write_text("id,label\n0,good\n2,good\n")
    with pytest.raises(DataError, match=r"^[^\n]+[.]$") as caught:
        find(path).keep("kept", [0, 2])
    assert LEROBOT[damage][1] in str(caught.value)
    assert not [*Path().glob("*kept*")]
    refused("", "keep", path, "-o", "kept", "--verdicts", "labels.csv")


@pytest.mark.skipif(os.name != "posix", reason="elsewhere a process ends otherwise")
def test_a_crash_of_a_library_prints_where_it_happened(tmp_path):
    np.savez(tmp_path / "a.npz", observations=np.eye(4), actions=[0, 1, 0, 1], episode_ids=[0, 0, 1, 1])
    crash = "import os, rpil.data.archive as npy\nnpy.read_arrays = lambda *_: os.abort()\n"
    script = f"import sys\nsys.argv = ['rpil', 'info', {str(tmp_path / 'a.npz')!r}]\n{crash}"
    script += "from rpil.cli.entry import main\nmain()\n"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode < 0
    assert "Fatal Python error: Aborted" in done.stderr
    assert "array_files.py" in done.stderr
