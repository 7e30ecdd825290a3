"""A folder and a ZIP file have the same files; none leads out of the store, and none is read beyond a limit."""

import os
import shutil
import zipfile
from pathlib import Path

import pytest

from rpil.data.errors import DataError
from rpil.formats.zarr_files import opened


@pytest.mark.parametrize("zipped", [False, True])
def test_no_more_than_a_limit_is_read(tmp_path, zipped):
    path = tmp_path / "store"
    (path / "data/x/0").mkdir(parents=True)
    (path / "data/x/0/1").write_bytes(b"123")
    with opened(Path(shutil.make_archive(str(path), "zip", path)) if zipped else path) as files:
        assert files.read("data/x/0/1", 3) == b"123"
        with pytest.raises(DataError, match=r"data/x/0/1 holds more than 2 bytes"):
            files.read("data/x/0/1", 2)


def test_members_of_a_zip_file_that_lead_out_of_it_or_are_packed_otherwise(tmp_path):
    path = tmp_path / "store.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("data/../.zarray", "data/./.zarray", "data//.zarray", "data/a\\b/.zarray", "/data/c/.zarray"):
            archive.writestr(name, "{}")
        archive.writestr("data/d/0", bytes(1000), zipfile.ZIP_BZIP2)
    with opened(path) as files:
        assert files.folders("data") == ["d"]
        with pytest.raises(DataError, match="compressed in a way"):
            files.read("data/d/0", 1000)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are pipes on POSIX only")
def test_a_pipe_is_no_file(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with opened(tmp_path) as files:
        assert files.names("") == []
        assert not files.has("pipe")
