"""A folder and a ZIP file have the same files; none leads out of the store, and none is read beyond a limit."""

import os
import zipfile

import pytest

from rpil.data.errors import DataError
from rpil.formats.zarr_files import opened

CONTENT = {"meta/ends/0": b"12", "data/x/.zarray": b"{}", "data/x/0/1": b"123", "data/y/0.0": b""}


@pytest.fixture(params=[False, True], ids=["folder", "zip"])
def store(request, tmp_path):
    path = tmp_path / ("store.zarr.zip" if request.param else "store.zarr")
    if request.param:
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in CONTENT.items():
                archive.writestr(name, content)
    else:
        for name, content in CONTENT.items():
            (path / name).parent.mkdir(parents=True, exist_ok=True)
            (path / name).write_bytes(content)
    with opened(path) as files:
        yield files


def test_no_more_than_a_limit_is_read(store):
    with pytest.raises(DataError, match=r"data/x/0/1 holds more than 2 bytes"):
        store.read("data/x/0/1", 2)


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
