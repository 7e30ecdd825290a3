"""The README: its commands run and print what it shows; `tests/cli/test_demo.py` compares its figures."""

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
SO100 = runpy.run_path(str(ROOT / "tools" / "so100.py"))
(KEEP,) = re.findall(r"^(rpil keep .*)$", TEXT, re.MULTILINE)
URLS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # commands warn where a user may overlook it
def test_commands_run_and_print_what_is_shown(tmp_path):
    """Without those that install or ask; labels.csv is what a user may answer."""
    pytest.importorskip("av", reason="PyAV is not installed: pip install 'rpil[video]'")
    (tmp_path / "labels.csv").write_text("id,label\n33,better than 38\n3,bad\n44,bad\n0,good\n", encoding="utf-8")
    left_out = re.compile(r"pip |rpil (label|review) ")
    printed, n_shown, names = "", 0, {}
    for name in ("drives", "so100"):
        runpy.run_path(str(ROOT / "tools" / f"{name}.py"), run_name="__main__")
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
    TUTORIALS["call"](shlex.split(KEEP.replace("-o so100_kept", "-o ids.json")), ROOT / "README.md", block)
    assert n_shown == 3
    assert names["audit"].finding == "outliers"
    assert len(names["weights"]) == 16_000
    broken = {SO100[name] for name in ("FROZEN_CAMERA", "FROZEN_JOINT", "JUMP", "DROPPED")}
    rejected = set(range(50)) - set(json.loads((tmp_path / "ids.json").read_text())["episodes"])
    assert (len(rejected), len(rejected - broken - set(SO100["DISTRACTED"]))) == (12, 0)


def test_links_and_addresses_are_those_of_the_repository_and_lead_to_files():
    """A package index shows the README, too, and has no files beside it. It is short, and the picture comes soon."""
    assert len(TEXT.splitlines()) <= 120
    assert len(TEXT.split()) <= 1000
    assert "![" in "\n".join(TEXT.splitlines()[:40])
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
