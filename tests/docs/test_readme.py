"""The README is one screen and a little more; `tests/cli/test_demo.py` compares its figures with the demo's."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) < 150
