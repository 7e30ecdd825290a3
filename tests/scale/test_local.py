"""The engine of one process does with blocks what a loop does."""

from __future__ import annotations

import gc
import shutil
import tempfile
from threading import Barrier
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from rpil.data.errors import DataError
from rpil.scale import local
from rpil.scale.local import LocalEngine, StepFile, gathered
from rpil.scale.protocol import Engine, Shards


class Steps(NamedTuple):
    values: np.ndarray
    products: np.ndarray

    @classmethod
    def of(cls, block):
        return cls(block, np.stack([block, block**2], axis=1).astype(np.float32))


SHARDS = [[np.array([1.0, 2.0]), np.array([3.0])], [np.array([4.0])]]


def test_blocks_are_mapped_in_order_side_by_side_and_added_up(monkeypatch):
    engine = LocalEngine()
    assert isinstance(engine, Engine)
    placed = engine.place(SHARDS)
    assert isinstance(placed, Shards)
    assert list(placed.map(len)) == [2, 1, 1]
    halves = placed.then(lambda block: block / 2)
    assert [block.tolist() for block in halves.map(lambda block: block)] == [[0.5, 1.0], [1.5], [2.0]]
    assert halves.total(lambda block: (block.sum(), len(block))) == (5.0, 4)
    monkeypatch.setattr(local, "cores", lambda: 2)
    both = Barrier(2, timeout=10)  # at which one block waits for the other
    assert sorted(engine.place([range(2)]).map(lambda _: both.wait())) == [0, 1]


def test_blocks_are_computed_in_every_pass_until_they_are_kept(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    computed = []
    placed = LocalEngine().place(SHARDS).then(lambda block: computed.append(block) or Steps.of(block))
    passes = [list(placed.map(lambda steps: steps)) for _ in range(2)]
    assert len(computed) == 6
    kept = placed.kept(4)
    passes += [list(kept.map(lambda steps: steps)) for _ in range(2)]
    assert len(computed) == 9
    for own, *back in zip(*passes, strict=True):
        for array, *same in zip(own, *back, strict=True):
            assert {one.dtype for one in same} == {array.dtype}
            np.testing.assert_array_equal([array] * 3, same)
    assert not list(tmp_path.iterdir())


def test_what_is_written_by_blocks_is_read_by_blocks_and_whole(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    rng = np.random.default_rng(0)
    arrays = rng.normal(size=(9, 3)).astype(np.float32), rng.integers(5, size=9), rng.normal(size=9)
    file = StepFile(9)
    for steps in (slice(0, 4), slice(4, 5), slice(5, 9)):
        file.append(tuple(array[steps] for array in arrays))
    parts, whole = [file.read(steps) for steps in file.blocks], file.read(slice(0, 9))
    np.testing.assert_array_equal(gathered([arrays[2][:4], arrays[2][4:]], 9), arrays[2])
    assert not list(tmp_path.iterdir())  # the file has no name, so that nothing is left where a process is killed
    del file
    gc.collect()
    for k, array in enumerate(arrays):
        assert whole[k].dtype == array.dtype
        np.testing.assert_array_equal(whole[k], array)
        np.testing.assert_array_equal(np.concatenate([part[k] for part in parts]), array)


def test_room_is_checked_before_the_first_block_is_written(monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=32_000_000))
    block = np.zeros(2), np.zeros((2, 3), np.float32)
    StepFile(1_600_000).append(block)
    with pytest.raises(DataError, match=r"0.04 GB for a temporary file, and .* has 0.03 GB free; set TMPDIR"):
        StepFile(2_000_000).append(block)
