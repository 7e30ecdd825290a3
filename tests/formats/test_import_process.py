"""Work in a process of its own: its result, its errors, and whatever ends it."""

from __future__ import annotations

import os
import signal
import sys
import time

import numpy as np
import pytest

from rpil.data.errors import DataError, MissingExtraError
from rpil.data.memory import TooLargeError, check_memory
from rpil.formats import import_process
from rpil.formats.import_process import in_child

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits a process")


def test_the_result_and_no_other_trace_come_back():
    here = []
    assert in_child(lambda: [os.getpid() != parent, here.append(1), {"a": [1.5, "\udcff"]}], "a.h5", 0) == [
        True,
        None,
        {"a": [1.5, "\udcff"]},
    ]
    assert here == []


parent = os.getpid()


def fail(error):
    raise error


def test_a_process_that_does_not_begin_is_made_anew(monkeypatch):
    fork, forks = os.fork, []

    def stuck_at_first():
        forks.append(1)
        child = fork()
        if not child and len(forks) == 1:
            time.sleep(60)
        monkeypatch.setattr(import_process, "_BEGINNING", 0.5 if len(forks) == 1 else 60)  # slow machines begin late
        return child

    monkeypatch.setattr(os, "fork", stuck_at_first)
    assert in_child(lambda: 7, "a.h5", 0) == 7
    assert len(forks) == 2


def test_errors_are_those_of_the_work():
    with pytest.raises(DataError, match=r"^a.h5: use memory=.$") as caught:
        in_child(lambda: fail(DataError("a.h5: use <option>.", "memory")), "a.h5", 0)
    assert caught.value.in_shell == "a.h5: use --memory."
    with pytest.raises(TooLargeError, match=r"more than the 1.0 MB"):
        in_child(lambda: check_memory(1e9, "a.h5", "1MB"), "a.h5", 0)
    with pytest.raises(MissingExtraError, match=r"^This needs an optional package.*rpil\[zarr\]"):
        in_child(lambda: fail(MissingExtraError("This", "zarr")), "a.h5", 0)
    with pytest.raises(OSError, match=r"No space left") as full:
        in_child(lambda: fail(OSError(28, "No space left on device", "out.h5")), "a.h5", 0)
    assert (full.value.errno, full.value.filename) == (28, "out.h5")
    with pytest.raises(DataError, match=r"^a.h5: it cannot be read \(KeyError: 'x'\)"):
        in_child(lambda: {}["x"], "a.h5", 0)


def test_more_memory_than_is_allowed_is_one_sentence():
    with pytest.raises(DataError, match=r"^a.h5: more memory than is free"):
        in_child(lambda: len(np.zeros(2**31, dtype=np.uint8)), "a.h5", 0, "1MB")
    assert in_child(lambda: len(np.zeros(2**31, dtype=np.uint8)), "a.h5", 0, "4GB") == 2**31


def test_an_endless_work_is_ended(monkeypatch):
    monkeypatch.setattr(import_process, "_LEAST_SECONDS", 1)

    def count():
        while True:
            pass

    with pytest.raises(DataError, match=r"^a.h5: to read it took more than 1 s; it is damaged"):
        in_child(count, "a.h5", 0)
    monkeypatch.setattr(import_process, "_WAITING", 0.5)
    with pytest.raises(DataError, match=r"^a.h5: to read it took more than 0.5 s"):
        in_child(lambda: time.sleep(60), "a.h5", 0)


@pytest.mark.parametrize(
    ("number", "sentence"), [(signal.SIGSEGV, "ended by it .SIGSEGV.; it is damaged"), (signal.SIGKILL, "more memory")]
)
def test_a_death_is_one_sentence(number, sentence, capfd):
    with pytest.raises(DataError, match=rf"^a.h5: .*{sentence}"):
        in_child(lambda: os.kill(os.getpid(), number), "a.h5", 0)
    assert capfd.readouterr().err == ""


def test_an_interruption_ends_the_work(tmp_path):
    begun = tmp_path / "begun"

    def work():
        begun.write_text(str(os.getpid()))
        os.kill(parent, signal.SIGINT)
        time.sleep(60)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background it is ignored
    try:
        with pytest.raises(KeyboardInterrupt):
            in_child(work, "a.h5", 0)
    finally:
        signal.signal(signal.SIGINT, before)
    with pytest.raises(ProcessLookupError):
        os.kill(int(begun.read_text()), 0)
