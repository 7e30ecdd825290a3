"""Engines of one process do with blocks what a loop does."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.scale.local import InMemory, Streamed
from rpil.scale.protocol import Engine, Shards

SHARDS = [[np.array([1.0, 2.0]), np.array([3.0])], [np.array([4.0])]]


@pytest.mark.parametrize("engine", [InMemory(), Streamed()])
def test_blocks_are_mapped_in_order_and_added_up(engine):
    assert isinstance(engine, Engine)
    placed = engine.place(SHARDS)
    assert isinstance(placed, Shards)
    assert list(placed.map(len)) == [2, 1, 1]
    halves = placed.then(lambda block: block / 2)
    assert [block.tolist() for block in halves.map(lambda block: block)] == [[0.5, 1.0], [1.5], [2.0]]
    assert halves.total(lambda block: (block.sum(), len(block))) == (5.0, 4)


def test_memory_reads_a_shard_once_and_disk_reads_it_for_every_pass():
    for engine, times in ((InMemory(), 1), (Streamed(), 3)):
        readings = []

        class Recorded(list):
            def __iter__(self, readings=readings):
                readings.append(len(self))
                return super().__iter__()

        placed = engine.place([Recorded(SHARDS[0])])
        for _ in range(3):
            list(placed.map(len))
        assert len(readings) == times
