import os
import signal
from contextlib import suppress

import pytest

from problems import refused_file
from rpil.data.archive import read_archive
from rpil.data.errors import DataError
from rpil.data.files import check_exists, check_extension, check_outputs, check_readable, check_writable, replacing


@pytest.mark.parametrize(
    ("crash", "seen"),
    [
        (RuntimeError(), pytest.raises(RuntimeError)),
        (KeyboardInterrupt(), pytest.raises(KeyboardInterrupt)),
        (OSError(28, "No space left on device"), pytest.raises(DataError, match=r"out\.txt: .*No space left.*\.$")),
    ],
)
def test_a_crash_and_a_full_disk_leave_the_old_file(tmp_path, crash, seen):
    path = tmp_path / "out.txt"
    path.write_text("old")
    with seen, replacing(path) as temporary:
        temporary.write_text("half")
        raise crash
    assert (path.read_text(), os.listdir(tmp_path)) == ("old", ["out.txt"])


def test_a_replaced_file_keeps_its_permissions_and_a_link_stays_a_link(tmp_path):
    path, link, new, usual = (tmp_path / name for name in ("out.txt", "link.txt", "new.txt", "usual.txt"))
    usual.touch()
    path.touch()
    link.symlink_to(path)
    for mode in (0o600, 0o640, 0o755):
        path.chmod(mode)
        with replacing(link) as temporary:
            assert temporary.stat().st_mode & 0o077 & ~mode == 0  # nor may others read it before
            temporary.write_text("new")
        assert path.stat().st_mode & 0o777 == mode
        assert link.is_symlink()
    with replacing(new) as temporary:
        temporary.write_text("new")
    assert new.stat().st_mode == usual.stat().st_mode


@pytest.mark.parametrize("check", [check_writable, lambda path: replacing(path).__enter__()])
def test_bad_output_paths(tmp_path, monkeypatch, check):
    refused_file("no folder", check, tmp_path / "no" / "out.txt")
    refused_file("it is a folder", check, tmp_path)
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # the tests may run as root, who may do anything
    refused_file("may not be written", check, tmp_path / "out.txt")


def test_bad_input_paths(tmp_path, monkeypatch):
    empty, full = tmp_path / "empty.csv", tmp_path / "full.csv"
    empty.touch()
    full.write_text("x")
    assert check_readable(str(full)) == full
    for path, match in (
        (tmp_path / "no.csv", "no such file or folder; check the path"),
        (tmp_path, "folder"),
        (empty, "the file is empty"),
    ):
        refused_file(match, check_readable, path)
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    refused_file("may not be read", check_readable, full)


def test_a_new_folder_is_whole_or_not_there(tmp_path):
    with suppress(KeyError), replacing(tmp_path / "out") as folder:
        folder.mkdir()
        (folder / "a").write_text("half")
        raise KeyError
    assert not list(tmp_path.iterdir())
    with replacing(tmp_path / "out") as folder:
        folder.mkdir()
        (folder / "a").write_text("whole")
    assert (tmp_path / "out" / "a").read_text() == "whole"


def test_names_may_have_as_many_bytes_as_file_systems_take(tmp_path):
    for name in ("a" * 247 + ".parquet", "é" * 118 + ".parquet"):
        with replacing(tmp_path / name) as temporary:
            assert temporary.suffix == ".parquet"
            temporary.write_text("new")
    with pytest.raises(DataError, match="its name is longer than 255 bytes"), replacing(tmp_path / ("a" * 256)):
        pass
    assert len([*tmp_path.iterdir()]) == 2


@pytest.mark.parametrize("check", [check_exists, check_readable, read_archive])
def test_a_pipe_is_no_input(tmp_path, check):
    os.mkfifo(tmp_path / "pipe.rpil")
    before = signal.signal(signal.SIGALRM, lambda *_: pytest.fail("the pipe is waited for"))
    signal.alarm(10)
    try:
        with pytest.raises(DataError, match="neither a file nor a folder"):
            check(tmp_path / "pipe.rpil")
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def test_an_output_is_named_once_and_joins_no_input(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "d.csv").write_text("x")
    check_outputs(["data", "d.csv", None], ["e.csv", None])
    check_outputs(["a[1].csv"], ["a1.csv"])  # an input is no pattern
    for inputs, outputs, match in (
        (["data"], ["data/e.csv"], "it would join the data in .*data; write it to another folder"),
        ([], ["e.csv", "./e.csv"], "it is named twice"),
        (["d.csv"], ["d.csv"], "it is named twice"),
    ):
        with pytest.raises(DataError, match=match):
            check_outputs(inputs, outputs)


def test_an_unknown_extension_is_named_with_those_that_fit():
    assert check_extension("A.CSV", [".csv"]).name == "A.CSV"
    with pytest.raises(DataError, match=r"a\.txt: unknown extension '\.txt' for labels; use one of \.csv, \.json"):
        check_extension("a.txt", [".csv", ".json"], "labels")
