"""The README is one screen and a little more; `tests/cli/test_demo.py` compares its figures with the demo's."""

from __future__ import annotations

import re
import runpy
import struct
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
URLS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]


def test_readme_is_short():
    assert len(TEXT.splitlines()) < 120


def test_links_are_those_of_the_repository_and_lead_to_files():
    """A package index shows the README, too, and has no files beside it."""
    links = dict(re.findall(r"^\[(.+)\]: (\S+)$", TEXT, re.MULTILINE))
    assert "](" not in TEXT
    assert "<img" not in TEXT
    for url in links.values():
        path = re.fullmatch(rf"{re.escape(URLS['Repository'])}/(?:blob|raw)/main/(\S+)", url)
        assert path is not None, url
        assert (ROOT / path[1]).is_file(), url
    used = re.findall(r"\[([^\]]+)\](?![:\[])", re.sub(r"```.*?```|`[^`]*`", "", TEXT, flags=re.DOTALL))
    used = {" ".join(label.lower().split()) for label in used}
    assert used == set(links)
    assert TEXT.count("![") == 1


def test_addresses_of_the_project_are_those_of_the_repository():
    assert {"Repository", "Documentation", "Changelog", "Issues"} <= set(URLS)
    assert all(url.startswith(URLS["Repository"]) for url in URLS.values())


def test_the_picture_is_wide_enough_to_read_and_small():
    """`tools/draw_review.py` draws it."""
    data = (ROOT / "docs" / "review.png").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", data[16:24]) == runpy.run_path(str(ROOT / "tools" / "draw_review.py"))["SIZE"]
    assert len(data) < 300_000
