"""`tools/crafted_files.py`: some of its cases; what reading may take is limited by tests/data/test_hostile_*.py."""

from importlib import import_module
from pathlib import Path

import pytest

CASES = ("tiny observations", "very long label quoted", "ids with white space", "video times that are no numbers")


@pytest.mark.parametrize("name", [*CASES, pytest.param("damaged files", marks=pytest.mark.slow)])
def test_a_case_is_as_it_should_be(name, capsys, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "tools"))
    assert import_module("crafted_files").main(["--only", name]) == 0
    assert capsys.readouterr().out.startswith(f"{name}: as it should be (")
