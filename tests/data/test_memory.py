"""Sizes in words, and the refusal of data that would not fit."""

import math

import pytest

from rpil.data import memory
from rpil.data.errors import DataError


@pytest.mark.parametrize(
    ("size", "n_bytes"), [("4GB", 4e9), ("500 mb", 5e8), ("2GiB", 2.0**31), ("1.5k", 1500), (1000, 1000), ("7b", 7)]
)
def test_sizes(size, n_bytes):
    assert memory.parse_size(size) == n_bytes


@pytest.mark.parametrize("size", ["", "GB", "-1GB", "4 apples", "0", "1e9", "ib", math.inf, math.nan])
def test_what_is_no_size_is_refused(size):
    with pytest.raises(DataError, match="no amount of memory; give one such as"):
        memory.parse_size(size)


def test_what_is_given_may_be_taken_or_else_half_of_what_is_free(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 1e9)
    memory.check_memory(3e7, "x.npz", "30MB")
    with pytest.raises(DataError, match=r"x.npz: to read it would take 0.3 GB of memory, more than the 0.02 MB"):
        memory.check_memory(3e8, "x.npz", "20KB")
    memory.check_memory(2e9, "x.npz", 2e9)
    memory.check_memory(5e8, "x.npz")
    with pytest.raises(DataError):
        memory.check_memory(6e8, "x.npz")


def test_parts_of_files_are_compared_with_half_of_the_free_memory(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 400e6)
    memory.check_free(199e6)
    with pytest.raises(MemoryError):
        memory.check_free(201e6)
    monkeypatch.setattr(memory, "free_memory", lambda: 1.0)
    memory.check_free(60e6)  # which is not worth the look
