"""Folders: Parquet files come before text tables, and an empty folder is refused."""

import numpy as np
import pytest

from rpil.data import formats
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.formats import folder
from rpil.data.formats.columns import ColumnOptions


def test_parquet_comes_before_text(tmp_path):
    with pytest.raises(DataError, match=r"no \.parquet or \.csv file is there"):
        folder.read(tmp_path, ColumnOptions())
    demonstrations = Demonstrations.from_episodes([(np.zeros((3, 1)), [0, 1, 0])])
    formats.write(tmp_path / "a.csv", demonstrations)
    assert folder.read(tmp_path, ColumnOptions()).description.format == "CSV, 1 files"
    formats.write(tmp_path / "b.parquet", demonstrations)
    recording = folder.read(tmp_path, ColumnOptions())
    assert recording.description.format == "Parquet"
    assert recording.description.ignored["a.csv"] == "a text table beside Parquet files"
