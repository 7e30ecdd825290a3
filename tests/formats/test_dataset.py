"""Demonstrations on disk are those in memory, block by block."""

from __future__ import annotations

import pickle
from itertools import chain

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil
from recorded import demonstrations, write_files, written
from rpil import formats
from rpil.data.errors import DataError
from rpil.formats import table as flat
from samples import assert_same

BLOCK_STEPS = 700


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    """Hundreds of rows fill a batch."""
    monkeypatch.setattr("rpil.formats.steps.BATCH_ROWS", 130)


CASES = {
    "discrete": (demonstrations, lambda t: t),
    "continuous": (lambda: demonstrations(continuous=True), lambda t: t),
    "text actions": (
        demonstrations,
        lambda t: t.set_column(
            t.column_names.index("action"), "action", pa.array([f"a{a}" for a in t["action"].to_pylist()])
        ),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_blocks_and_selections_are_those_in_memory(tmp_path, case):
    made, change = CASES[case]
    table = change(flat.from_demonstrations(made(), {}))
    pq.write_table(table, tmp_path / "whole.parquet")
    memory = formats.read(tmp_path / "whole.parquet")
    data = rpil.open(
        write_files(table, tmp_path / "many" / "data" / "chunk-000").parents[1], on_disk=True
    ).demonstrations
    assert (data.n_steps, len(data), data.n_observations) == (memory.n_steps, len(memory), memory.n_observations)
    assert data.is_discrete == memory.is_discrete
    np.testing.assert_array_equal(data.lengths, memory.lengths)
    assert_same(data.select(slice(None)), memory)
    some = [100, 3, 4, 50, 119, 0]
    assert_same(data.select(some), memory.select(some))
    for n_shards in (1, 3, 1000):
        shards, wanted = data.shards(n_shards, BLOCK_STEPS), memory.shards(n_shards, BLOCK_STEPS)
        assert [len(list(shard)) for shard in shards] == [len(shard) for shard in wanted]
        for ours, theirs in zip(chain(*shards), chain(*wanted), strict=True):
            assert ours.first == theirs.first
            for name in ("observations", "actions", "offsets"):
                np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
                assert getattr(ours, name).dtype == getattr(theirs, name).dtype
    assert data.nbytes == memory.observations.nbytes + memory.actions.nbytes


def test_files_with_other_columns_or_of_another_kind_are_refused(tmp_path):
    table = flat.from_demonstrations(demonstrations(), {})
    folder = write_files(table, tmp_path / "many")
    pq.write_table(
        table.rename_columns([n.replace("observation.1", "observation.x") for n in table.column_names]),
        folder / "3.parquet",
    )
    which = "without 'observation.1' and with 'observation.x'"
    with pytest.raises(
        DataError, match=rf"3.parquet: its columns are not those of 0.parquet .{which}.; .* take it out"
    ):
        rpil.open(folder, on_disk=True)
    (folder / "3.parquet").write_bytes(b"PAR1 this is none PAR1")
    with pytest.raises(DataError, match=r"^many: damaged, .*: 3\.parquet; .* skip_bad=True\.$"):
        rpil.open(folder, on_disk=True)
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match=r"no \.parquet or \.csv file is there"):
        rpil.open(tmp_path / "empty", on_disk=True)


def test_a_shard_can_be_pickled(tmp_path):
    data = rpil.open(written(tmp_path), on_disk=True, without=5).demonstrations  # whose rows have other numbers
    shard = data.shards(4, BLOCK_STEPS)[2]
    sent = pickle.dumps(shard)
    assert len(sent) < 4000
    for ours, theirs in zip(pickle.loads(sent), shard, strict=True):  # noqa: S301
        np.testing.assert_array_equal(ours.observations, theirs.observations)
