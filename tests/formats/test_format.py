"""What every format's record refuses, and what it leaves out."""

from __future__ import annotations

import pytest

from rpil.data.errors import DataError
from rpil.formats.registry import find
from samples import SAMPLES


@pytest.mark.parametrize("name", ["out.csv", "out.hdf5", "out.zip"])
def test_a_folder_is_no_file(tmp_path, name):
    data = SAMPLES["LeRobot"](tmp_path)
    with pytest.raises(DataError, match="the data are a folder, so name a folder"):
        find(data).keep(tmp_path / name, ["0"])


@pytest.mark.parametrize("address", ["s3://KEY:HIDDEN@bucket/data", "https://a.org/x.csv?token=HIDDEN", "hf://a/b/c"])
def test_addresses_are_not_read_and_their_secrets_not_shown(address):
    scheme = address.partition("://")[0]
    with pytest.raises(DataError, match=rf"^{scheme}://\.\.\.: addresses are not read; download the data"):
        find(address)
