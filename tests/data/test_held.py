"""Within `holding` a file is opened once, and closed at the end."""

from __future__ import annotations

import contextvars
import threading
from contextlib import contextmanager

import pytest

from rpil.data import held as held_files
from rpil.data.held import held, held_bytes, holding


@pytest.fixture
def log():
    return []


def opener(log, name):
    @contextmanager
    def open_it():
        log.append(f"open {name}")
        yield name
        log.append(f"close {name}")

    return open_it


def use(log, name, kind=""):
    with held(name, opener(log, name), kind) as one:
        assert one == name


def test_a_file_is_opened_once_and_closed_at_the_end(log):
    with holding():
        use(log, "a")
        with holding():
            use(log, "a")
        assert log == ["open a"]
        use(log, "a", "by another library")
    assert log == ["open a", "open a", "close a", "close a"]


def test_no_more_files_than_a_process_may_have_stay_open(log, monkeypatch):
    monkeypatch.setattr(held_files, "MOST_OPEN", 1)
    with holding():
        for name in "aba":
            use(log, name)
        assert log == ["open a", "open b", "close b"]


def test_an_error_closes_the_files(log):
    with pytest.raises(ValueError, match="wrong"), holding(), held("a", lambda: closing(log)):
        raise ValueError("wrong")
    assert log == ["closed"]
    use(log, "b")
    assert log == ["closed", "open b", "close b"]


@contextmanager
def closing(log):
    try:
        yield
    finally:
        log.append("closed")


def test_another_thread_opens_a_file_of_its_own(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"0123456789")
    with holding(), held_bytes(path) as own:
        assert own.read(3) == b"012"
        context = contextvars.copy_context()
        read = []

        def elsewhere():
            with held_bytes(path) as other:
                read.append(other.read())

        thread = threading.Thread(target=lambda: context.run(elsewhere))
        thread.start()
        thread.join()
        assert read == [b"0123456789"]
        assert own.read() == b"3456789"


def test_the_bytes_of_a_held_file_are_read_from_the_first_one(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"abc")
    with holding():
        for _ in range(2):
            with held_bytes(path) as stream:
                assert stream.read() == b"abc"
        path.unlink()
        with held_bytes(path) as stream:
            assert stream.read(1) == b"a"
    with pytest.raises(FileNotFoundError), held_bytes(path):
        pass
