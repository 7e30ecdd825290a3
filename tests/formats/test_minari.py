"""Folders of Minari are refused with the way to go; tests/data/test_episodes.py reads its episodes."""

from __future__ import annotations

import pytest

import rpil
from rpil.data.errors import DataError


@pytest.mark.parametrize(
    ("given", "file"), [("set", "main_data.hdf5"), ("set", "0/part-0.arrow"), ("set/data", "0/part-0.parquet")]
)
def test_a_folder_is_refused_with_the_way_to_go(tmp_path, given, file):
    data = tmp_path / "set" / "data"
    (data / "0").mkdir(parents=True)
    (data / "metadata.json").write_text('{"data_format": "parquet", "total_episodes": 1}')
    (data / file).write_bytes(b"PAR1")
    with pytest.raises(DataError, match=r"it is a data set of Minari; read it in Python, by rpil\.read\(minari\."):
        rpil.read(tmp_path / given)
