"""The code of docs/python.md runs in its order, and prints what the page says."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import matplotlib
import pytest

from rpil.results.plots import AuditPlots

TEXT = (Path(__file__).parents[2] / "docs" / "python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(python|text)\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


@pytest.mark.slow
def test_the_code_runs_and_prints_what_the_page_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    names: dict[str, object] = {}
    printed = ""
    for kind, text in BLOCKS:
        if kind == "text":
            assert printed == text
            continue
        with contextlib.redirect_stdout(io.StringIO()) as out:
            exec(compile(text, "docs/python.md", "exec"), names)
        printed = out.getvalue()
    assert {path.name for path in tmp_path.iterdir()} == {"audit.html", "steps.png"}


def test_the_page_names_every_picture():
    named = set(re.findall(r"audit\.plot\.(\w+)", TEXT))
    assert named == {name for name in vars(AuditPlots) if not name.startswith("_") and name != "audit"}
