from types import SimpleNamespace

import pytest

import rpil
from rpil import formats
from rpil.data.errors import DataError
from rpil.formats import registry


def test_a_layout_comes_before_the_extension(tmp_path, monkeypatch):
    kept = []
    layout = SimpleNamespace(
        is_mine=lambda path: path.read_text() == "mine",
        read=lambda path, options: SimpleNamespace(demonstrations="read"),
        keep=lambda path, output, ids: kept.append((path, output, ids)),
    )
    monkeypatch.setattr(registry, "LAYOUTS", (layout,))
    mine, other = tmp_path / "mine.csv", tmp_path / "other.csv"
    mine.write_text("mine")
    other.write_text("episode_index,action,observation.x\n0,a,1\n")
    assert formats.read_recording(mine).demonstrations == "read"
    formats.keep(mine, tmp_path / "out", [1])
    assert kept == [(mine, tmp_path / "out", [1])]
    assert rpil.read(other).ids == (0,)
    assert registry.find_layout(tmp_path / "missing.csv") is None
    with pytest.raises(DataError, match="no such file"):
        formats.read_recording(tmp_path / "missing.csv")
