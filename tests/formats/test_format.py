"""What every format's record refuses, and what it leaves out."""

from __future__ import annotations

from pathlib import Path

import pytest

from rpil.data.errors import DataError
from rpil.formats.registry import find
from samples import SAMPLES


@pytest.mark.parametrize("name", ["out.csv", "out.hdf5", "out.zip"])
def test_a_folder_is_no_file(tmp_path, name):
    data = SAMPLES["LeRobot"](tmp_path)
    with pytest.raises(DataError, match="the data are a folder, so name a folder"):
        find(data).keep(tmp_path / name, ["0"])


@pytest.mark.parametrize("address", ["s3://bucket/data", "https://a.org/x.csv", "hf://datasets/a/b/c"])
def test_addresses_are_not_read(address):
    with pytest.raises(DataError, match=f"{address}: addresses are not read; download the data"):
        find(address)
    with pytest.raises(DataError, match="no such file"):
        find(Path(address))
