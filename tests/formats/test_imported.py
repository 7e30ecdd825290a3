"""A file that a process of its own reads is the recording that reading it here gives."""

from __future__ import annotations

import os

import numpy as np
import pytest

import rpil
from rpil.data import held
from rpil.data.errors import DataError
from rpil.formats import imported as importing
from rpil.formats.columns import ColumnOptions
from rpil.formats.imported import imported, size_of
from samples import SAMPLES


@pytest.mark.parametrize("on_the_disk", [False, True])
def test_what_is_imported_is_what_is_read_here(tmp_path, monkeypatch, on_the_disk):
    path = SAMPLES["robomimic"](tmp_path)
    there = rpil.open(path, on_disk=on_the_disk)
    monkeypatch.setattr(importing.sys, "platform", "win32")
    monkeypatch.setattr(held, "_CAN_REPLACE", False)
    here = rpil.open(path, on_disk=on_the_disk)
    assert there.description == here.description
    assert type(there.demonstrations) is type(here.demonstrations)
    a, b = (data.demonstrations.select(slice(None)) for data in (there, here))
    np.testing.assert_array_equal(a.observations, b.observations)
    np.testing.assert_array_equal(a.actions, b.actions)


def test_a_reader_that_ends_its_process_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    (tmp_path / "a.h5").write_bytes(b"x" * 7)
    with pytest.raises(DataError, match=r"a.h5: the library that reads it was ended"):
        imported(os.abort, tmp_path / "a.h5", ColumnOptions(on_disk=True), is_parquet=False)
    assert [file.name for file in tmp_path.rglob("*")] == ["a.h5"]
    assert size_of(tmp_path) == size_of(tmp_path / "a.h5") == 7
