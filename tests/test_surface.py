"""The public surface is that of docs/surface.txt; docs/stability.md says what a change of it means."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

TOOL = runpy.run_path(str(Path(__file__).parents[1] / "tools" / "public_surface.py"))


@pytest.mark.slow
def test_the_surface_is_the_one_that_is_written_down():
    """A line that goes is a change that breaks others: it needs a line in the change log, and a new minor version."""
    written = TOOL["SURFACE"].read_text(encoding="utf-8").splitlines()
    now = TOOL["surface"]().splitlines()
    gone, new = sorted(set(written) - set(now)), sorted(set(now) - set(written))
    assert (gone, new) == ([], []), "is it meant? python tools/public_surface.py --write"


def test_defaults_count_and_their_values_do_not_and_keys_are_paths():
    """Those of the data are left out."""

    def call(data, labels=None, *, seed: int = 0, **columns): ...

    assert TOOL["parameters"](call) == "(data, labels=..., *, seed=..., **columns)"
    value = {"a": {"b": [{"c": 1}]}, "counts": {"jump": 3}, "d": ["x"]}
    assert list(TOOL["keys"](value)) == ["a", "a.b", "a.b[].c", "counts", "d"]
