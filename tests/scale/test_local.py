"""The engine of one process does with blocks what a loop does."""

from __future__ import annotations

import tempfile
from typing import NamedTuple

import numpy as np

from rpil.scale import local
from rpil.scale.local import LocalEngine
from rpil.scale.protocol import Engine, Shards


class Steps(NamedTuple):
    values: np.ndarray
    products: np.ndarray

    @classmethod
    def of(cls, block):
        return cls(block, np.stack([block, block**2], axis=1).astype(np.float32))


SHARDS = [[np.array([1.0, 2.0]), np.array([3.0])], [np.array([4.0])]]


def test_blocks_are_mapped_in_order_and_added_up():
    engine = LocalEngine()
    assert isinstance(engine, Engine)
    placed = engine.place(SHARDS)
    assert isinstance(placed, Shards)
    assert list(placed.map(len)) == [2, 1, 1]
    halves = placed.then(lambda block: block / 2)
    assert [block.tolist() for block in halves.map(lambda block: block)] == [[0.5, 1.0], [1.5], [2.0]]
    assert halves.total(lambda block: (block.sum(), len(block))) == (5.0, 4)


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


def test_few_blocks_are_in_memory(monkeypatch):
    monkeypatch.setattr(local, "cores", lambda: 2)
    read = []

    def shard():
        for k in range(9):
            read.append(k)
            yield k

    results = LocalEngine().place([shard()]).map(lambda block: block)
    assert next(results) == 0
    assert len(read) == 3
    assert list(results) == [*range(1, 9)]
