"""The weights file holds one row for each step, written block by block."""

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from rpil.data.copies import run_id
from rpil.data.errors import DataError
from rpil.formats import write_weights


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_each_step_has_its_weight_and_the_values_of_its_demonstration(tmp_path, monkeypatch, suffix):
    """They are written in blocks, here of one demonstration each."""
    monkeypatch.setattr("rpil.formats._BLOCK_STEPS", 2)
    path = tmp_path / f"w{suffix}"
    weight, proba, odds = np.array([0.1, 1 / 3, 1, 0, 5e-324]), np.array([0.9, 0.1]), np.array([2.2, -np.inf])
    write_weights(path, ["b", "a"], np.array([0, 2, 5]), weight, proba, odds)
    table = pq.read_table(path) if suffix == ".parquet" else pa.csv.read_csv(path)
    rows = np.array([0, 0, 1, 1, 1])
    expected = {"episode_index": ["b", "b", "a", "a", "a"], "step_index": [0, 1, 0, 1, 2], "weight": weight.tolist()}
    assert table.to_pydict() == expected | {"expert_proba": proba[rows].tolist(), "log_odds": odds[rows].tolist()}
    if suffix == ".parquet":
        assert pq.read_metadata(path).num_row_groups == 2
        run = table.schema.metadata[b"rpil.run"].decode()
        assert run == run_id(["b", "a"], np.array([0, 2, 5]), odds)
        assert run != run_id(["b", "a"], np.array([0, 2, 5]), odds + 1e-9)
    with pytest.raises(DataError, match=r"w\.npz: unknown extension .* use one of \.parquet, \.csv"):
        write_weights(tmp_path / "w.npz", [], [0], [], [], [])
