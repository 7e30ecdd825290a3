"""Arrays of steps in a temporary file come back as they were, by blocks and whole."""

from __future__ import annotations

import gc
import shutil
import tempfile
from types import SimpleNamespace

import numpy as np
import pytest

from rpil.data.errors import DataError
from rpil.scale.local import StepFile


def test_what_is_written_by_blocks_is_read_by_blocks_and_whole(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    rng = np.random.default_rng(0)
    arrays = rng.normal(size=(9, 3)).astype(np.float32), rng.integers(5, size=9), rng.normal(size=9)
    file = StepFile(9)
    for steps in (slice(0, 4), slice(4, 5), slice(5, 9)):
        file.append(tuple(array[steps] for array in arrays))
    parts = [file.read(steps) for steps in file.blocks]
    whole = file.read(slice(0, 9))
    assert not list(tmp_path.iterdir())  # the file has no name, so that nothing is left where a process is killed
    del file
    gc.collect()
    for k, array in enumerate(arrays):
        assert whole[k].dtype == array.dtype
        np.testing.assert_array_equal(whole[k], array)
        np.testing.assert_array_equal(np.concatenate([part[k] for part in parts]), array)


def test_room_is_checked_before_the_first_block_is_written(monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=32_000_000))
    block = np.zeros(2), np.zeros((2, 3), np.float32)
    StepFile(1_600_000).append(block)
    with pytest.raises(DataError, match=r"0.04 GB for a temporary file, and .* has 0.03 GB free; set TMPDIR"):
        StepFile(2_000_000).append(block)
