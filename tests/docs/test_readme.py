"""The README: its commands run and print what it shows; `tests/cli/test_demo.py` compares its figures."""

from __future__ import annotations

import contextlib
import doctest
import io
import json
import re
import runpy
import shlex
import struct
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TUTORIALS = runpy.run_path(str(ROOT / "tools" / "tutorials.py"))
DRAW = runpy.run_path(str(ROOT / "tools" / "draw_review.py"))
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
URLS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]


def test_readme_is_short():
    assert len(TEXT.splitlines()) <= 170
    assert len(TEXT.partition("[picture]:")[0].splitlines()) <= 150


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # commands warn where a user may overlook it
def test_commands_run_and_print_what_is_shown(tmp_path):
    """Those that install or ask, and those for developers, are left out; labels.csv is what a user may answer."""
    (tmp_path / "labels.csv").write_text("id,label\nP07,better than P28\nP23,bad\n", encoding="utf-8")
    left_out = re.compile(r"pip |make |rpil (demo|label|review) ")
    printed, n_shown, names = "", 0, {}
    with contextlib.chdir(tmp_path):
        runpy.run_path(str(ROOT / "tools" / "drives.py"), run_name="__main__")
        for block in TUTORIALS["blocks"](ROOT / "README.md"):
            if block.kind == "text":
                assert doctest.OutputChecker().check_output(block.text, printed, TUTORIALS["SAME"]), printed
                n_shown += 1
                continue
            with contextlib.redirect_stdout(io.StringIO()) as out:
                if block.kind == "python":
                    exec(compile(block.text, "README.md", "exec"), names)
                for line in block.text.splitlines() if block.kind == "sh" else ():
                    if not left_out.match(line):
                        TUTORIALS["call"](shlex.split(line, comments=True), ROOT / "README.md", block)
            printed = out.getvalue()
    assert n_shown == 2
    assert {"audit.html", "kept.csv", "verdicts.csv", "weights.parquet"} <= {path.name for path in tmp_path.iterdir()}
    assert names["audit"].finding == "outliers"


def test_what_was_found_in_public_data_stands_on_its_page():
    section = " ".join(TEXT.partition("## What it found")[2].partition("\n## ")[0].split())
    page = (ROOT / "docs" / "public.md").read_text(encoding="utf-8")
    quoted = re.findall(r'"([^"]+)"', section)
    assert len(quoted) >= 4
    assert [text for text in quoted if text not in page] == []


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
    data = (ROOT / "docs" / "review.png").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", data[16:24]) == DRAW["SIZE"]
    assert len(data) < 300_000


@pytest.mark.slow
def test_the_picture_is_of_the_page_of_today():
    """Where this fails, the page has changed: draw the picture again with ``python tools/draw_review.py``."""
    pytest.importorskip("av", reason="PyAV is not installed: pip install 'rpil[video]'")
    pytest.importorskip("uvicorn", reason="uvicorn is not installed: pip install 'rpil[review]'")
    with DRAW["served"]() as address:
        assert DRAW["made_of"](address) == json.loads((ROOT / "docs" / "review.json").read_text(encoding="utf-8"))
