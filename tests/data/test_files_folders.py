"""What lies in a folder of data: links out of it are refused, and pipes are never opened."""

import json
import os
import shutil
import subprocess
import sys

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil
from hostile import assert_refused
from rpil.data.errors import DataError
from rpil.data.files import check_folder, check_inside, copy_folder
from rpil.formats.registry import find

TABLE = pa.table({"episode_index": [0, 0, 1, 1], "observation.x": [0.5, 1.5, 2.5, 3.5], "action": [0, 1, 1, 0]})


@pytest.fixture
def folder(tmp_path):
    """A folder of two tables, one of them in a folder within it."""
    path = tmp_path / "drive"
    (path / "b").mkdir(parents=True)
    pq.write_table(TABLE.slice(0, 2), path / "a.parquet")
    pq.write_table(TABLE.slice(2), path / "b" / "b.parquet")
    return path


@pytest.fixture
def secret(tmp_path):
    """A folder outside, with a table of the same columns."""
    path = tmp_path / "home"
    path.mkdir()
    pq.write_table(TABLE.set_column(0, "episode_index", [[7, 7, 8, 8]]), path / "key.parquet")
    return path


READERS = {
    "read": rpil.read,
    "on disk": lambda path: rpil.open(path, on_disk=True).demonstrations,
    "keep": lambda path: find(path).keep(path.parent / "ids.json", [0]),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("place", ["c.parquet", "b/c.parquet", "c"])
def test_a_link_out_of_the_folder_is_refused(folder, secret, place, reader):
    link = folder / place
    link.symlink_to(secret / "key.parquet" if link.suffix else secret)
    with pytest.raises(DataError, match="link that leads out") as caught:
        READERS[reader](folder)
    assert_refused(["refused", str(caught.value)], str(link))
    assert not (folder.parent / "ids.json").exists()


def test_a_link_may_stay_in_the_folder_and_the_folder_may_be_a_link(folder):
    shutil.move(folder / "a.parquet", folder / "a.data")
    (folder / "a.parquet").symlink_to("a.data")
    shutil.move(folder / "b", folder / "c")
    (folder / "c" / "b").symlink_to("../a.data")
    link = folder.parent / "link"
    link.symlink_to(folder)
    for path in (folder, link):
        check_inside(path / "a.parquet", path)
        assert rpil.read(path).ids == (0, 1)


def test_hidden_folders_and_locks_of_editors_are_left_alone(folder, secret):
    (folder / ".venv").symlink_to(secret)
    (folder / ".git").mkdir()
    pq.write_table(TABLE.slice(0, 1), folder / ".git" / "c.parquet")
    (folder / ".git" / "hooks").symlink_to(secret)
    (folder / "b" / ".#b.parquet").symlink_to("me@host.123")
    assert rpil.read(folder).ids == (0, 1)
    copy_folder(folder / "b", folder.parent / "copy")
    assert os.listdir(folder.parent / "copy") == ["b.parquet"]
    (folder / "b" / ".c.parquet").symlink_to(secret / "key.parquet")
    with pytest.raises(DataError, match="link that leads out"):
        rpil.read(folder)


@pytest.mark.parametrize(
    ("link", "to", "said"),
    [("c.parquet", "d", r"c\.parquet: .* leads to nothing.*download"), ("c", "b", "a link leads to a folder; copy")],
)
def test_a_link_to_nothing_is_a_download_that_broke_off_and_no_folder_is_read_twice(folder, link, to, said):
    (folder / link).symlink_to(to)
    with pytest.raises(DataError, match=said):
        rpil.read(folder)


def test_a_folder_that_may_not_be_listed_hides_no_link(folder, secret, monkeypatch):
    """The tests may run as root, who may do anything."""
    scandir, may_open = os.scandir, [True]
    (folder / "b" / "c.parquet").symlink_to(secret / "key.parquet")

    def refuse(path):
        if str(path).endswith("b"):
            raise PermissionError(13, "no", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refuse)
    monkeypatch.setattr(os, "access", lambda path, mode: may_open[0])
    with pytest.raises(DataError, match="b: it may not be listed"):
        check_folder(folder)
    may_open[0] = False
    check_folder(folder)


def test_beside_data_and_meta_anything_may_lie(folder, secret):
    """Videos are often on another disk."""
    shutil.copytree(folder, folder / "data")
    (folder / "videos").symlink_to(secret)
    (folder / "raw").mkdir()
    (folder / "raw" / "key.parquet").symlink_to(secret / "key.parquet")
    assert rpil.read(folder).ids == (0, 1)
    (folder / "meta").symlink_to(secret)
    with pytest.raises(DataError, match="meta: it is a link that leads out"):
        rpil.read(folder)


def test_a_snapshot_of_the_hub_links_to_its_blobs_alone(folder, secret):
    snapshot = folder.parent / "datasets--me--drive" / "snapshots" / "1f2e"
    blobs = folder.parent / "datasets--me--drive" / "blobs"
    shutil.copytree(folder, snapshot / "data")
    blobs.mkdir()
    for file in list(snapshot.rglob("*.parquet")):
        shutil.move(file, blobs / file.name)
        file.symlink_to(os.path.relpath(blobs / file.name, file.parent))
    assert rpil.read(snapshot).ids == (0, 1)
    assert rpil.read(snapshot / "data").ids == (0, 1)
    c, a = snapshot / "data" / "c.parquet", blobs / "a.parquet"
    for link, target in ((c, "../../../../home/key.parquet"), (a, secret / "key.parquet")):  # the second in two steps
        link.unlink(missing_ok=True)
        link.symlink_to(target)
        with pytest.raises(DataError, match=rf"{link.stem}\.parquet: it is a link that leads out"):
            rpil.read(snapshot)
        link.unlink()


PIPES = [
    ("pipe.hdf5", "pipe.hdf5"),
    ("pipe.csv", "pipe.csv"),
    ("drive", "drive/meta/info.json"),
    ("drive", "drive/data/b.parquet"),
    ("drive/data/a.parquet", "drive/meta/tasks.jsonl"),
]


def test_a_pipe_is_never_opened(tmp_path):
    """In a process of its own, because who opens a pipe waits for ever."""
    pytest.importorskip("h5py", reason="needs the extra hdf5")
    paths = []
    for number, (path, pipe) in enumerate(PIPES):
        top = tmp_path / str(number)
        (top / pipe).parent.mkdir(parents=True)
        os.mkfifo(top / pipe)
        if path.startswith("drive"):
            (top / "drive" / "data").mkdir(exist_ok=True)
            pq.write_table(TABLE, top / "drive" / "data" / "a.parquet")
        paths.append(str(top / path))
    script = "import json, sys; from rpil import formats; from rpil.data.errors import DataError\n"
    script += "for path in sys.argv[1:]:\n    try: formats.read_recording(path)\n"
    script += "    except DataError as error: print(json.dumps(['refused', str(error)]))"
    done = subprocess.run(
        [sys.executable, "-c", script, *paths], capture_output=True, text=True, timeout=60, check=True
    )
    ends = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(ends) == len(PIPES)
    for end, (_, pipe) in zip(ends, PIPES, strict=True):
        assert_refused(end, pipe)
