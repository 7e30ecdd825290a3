import os
import subprocess
import sys
from contextlib import suppress

import pytest

from rpil.data.errors import DataError
from rpil.data.files import check_readable, check_writable, new_folder, replacing


def one_sentence(caught, path):
    message = str(caught.value)
    assert path.name in message
    assert "\n" not in message
    assert message.endswith(".")


def half_write(path, crash):
    with replacing(path) as temporary:
        temporary.write_text("half")
        raise crash


def test_replacing_writes(tmp_path):
    path = tmp_path / "out.txt"
    for text in ("first", "second"):
        with replacing(path) as temporary:
            assert temporary.parent == path.parent
            assert temporary.suffix == path.suffix
            temporary.write_text(text)
        assert path.read_text() == text
    assert os.listdir(tmp_path) == ["out.txt"]


@pytest.mark.parametrize("crash", [RuntimeError, KeyboardInterrupt])
def test_a_crash_leaves_the_old_file(tmp_path, crash):
    path = tmp_path / "out.txt"
    path.write_text("old")
    with pytest.raises(crash):
        half_write(path, crash)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["out.txt"]


def test_a_full_disk_is_one_sentence_and_leaves_the_old_file(tmp_path):
    path = tmp_path / "out.txt"
    path.write_text("old")
    with pytest.raises(DataError, match="No space left") as caught:
        half_write(path, OSError(28, "No space left on device"))
    one_sentence(caught, path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["out.txt"]


def test_the_next_run_removes_what_a_killed_one_left_of_the_same_output(tmp_path):
    script = "import os, sys; from rpil.data.files import replacing\n"
    script += "with replacing(sys.argv[1]) as path: path.write_text('half'); os.kill(os.getpid(), 9)"
    for name in ("out.txt", "other.txt"):
        subprocess.run([sys.executable, "-c", script, tmp_path / name], check=False)
    with replacing(tmp_path / "out.txt") as living:
        living.write_text("half")
        with replacing(tmp_path / "out.txt") as second:
            second.write_text("whole")
        left = sorted(os.listdir(tmp_path))
        assert left[-1] == "out.txt"
        assert [name.split(".")[1] for name in left[:-1]] == ["other", "out"]
        assert living.name in left


def test_a_link_stays_a_link(tmp_path):
    path, link = tmp_path / "out.txt", tmp_path / "link.txt"
    path.write_text("old")
    link.symlink_to(path)
    with replacing(link) as temporary:
        temporary.write_text("new")
    assert link.is_symlink()
    assert path.read_text() == "new"


@pytest.mark.parametrize("check", [check_writable, lambda path: replacing(path).__enter__()])
def test_bad_output_paths(tmp_path, monkeypatch, check):
    for path, match in ((tmp_path / "no" / "out.txt", "no folder"), (tmp_path, "it is a folder")):
        with pytest.raises(DataError, match=match) as caught:
            check(path)
        one_sentence(caught, path)
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # the tests may run as root, who may do anything
    with pytest.raises(DataError, match="may not be written") as caught:
        check(tmp_path / "out.txt")
    one_sentence(caught, tmp_path / "out.txt")


def test_bad_input_paths(tmp_path, monkeypatch):
    empty, full = tmp_path / "empty.csv", tmp_path / "full.csv"
    empty.touch()
    full.write_text("x")
    assert check_readable(str(full)) == full
    for path, match in ((tmp_path / "no.csv", "no such file"), (tmp_path, "folder"), (empty, "the file is empty")):
        with pytest.raises(DataError, match=match) as caught:
            check_readable(path)
        one_sentence(caught, path)
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(DataError, match="may not be read") as caught:
        check_readable(full)
    one_sentence(caught, full)


def test_a_new_folder_is_whole_or_not_there(tmp_path):
    with suppress(KeyError), new_folder(tmp_path / "out") as folder:
        (folder / "a").write_text("half")
        raise KeyError
    assert not list(tmp_path.iterdir())
    with new_folder(tmp_path / "out") as folder:
        (folder / "a").write_text("whole")
    assert (tmp_path / "out" / "a").read_text() == "whole"
    with pytest.raises(DataError, match="out: it is there already"), new_folder(tmp_path / "out"):
        pass
