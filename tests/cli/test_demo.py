"""The demo: bundled data with their licence, and the numbers in its report and in the README."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

import pytest

import rpil
from html_page import Page
from rpil.cli import demo
from rpil.results.result import look_first

ROOT = Path(__file__).parents[2]
NUMBER = r"-?\d+(?:\.\d+)?"
BUNDLED = files("rpil.cli") / "bundled"


def test_bundle_is_small_and_has_its_licence() -> None:
    notice = (ROOT / "NOTICE").read_text(encoding="utf-8")
    for words in ("overcooked-ai 1.1.0", "MIT License", "Copyright (c) 2019 Center for Human-Compatible AI", "AS IS"):
        assert words in notice
    assert demo.OVERCOOKED in notice
    assert {item.name: len(item.read_bytes()) < 150_000 for item in BUNDLED.iterdir()} == {demo.OVERCOOKED: True}


def test_the_ranking_agrees_with_the_truth_and_the_readme_quotes_it(tmp_path: Path) -> None:
    stages: list[str] = []
    sentence = demo.run(tmp_path / "demo.html", stages.append)
    assert stages
    auroc, spearman = map(float, re.findall(r"(?:AUROC|Spearman) (\d\.\d+)", sentence))
    assert auroc > 0.8
    assert spearman > 0.4
    sentence.encode("ascii")  # some terminals have no other characters
    page = Page((tmp_path / "demo.html").read_text(encoding="utf-8"))
    for words in ("Overcooked: real people", "32 demonstrations", "Compared with the truth", sentence):
        assert words in page.text
    quoted = " ".join(re.findall(r"^> ?(.*)$", (ROOT / "README.md").read_text(), re.MULTILINE))
    assert re.sub(NUMBER, "#", quoted) == re.sub(NUMBER, "#", sentence)
    for told, now in zip(re.findall(NUMBER, quoted), re.findall(NUMBER, sentence), strict=True):
        assert float(told) == pytest.approx(float(now), abs=0.02)


def test_picture_shows_the_landings_beside_it() -> None:
    rows = ElementTree.parse(ROOT / "docs" / "audit.svg").iter()
    texts = ["".join(row.itertext()) for row in rows if "text" in row.tag]
    rows = [re.fullmatch(r"(\d+) +(\w+) +([-+]\S+) +.*", text) for text in texts]
    shown = [row.groups() for row in rows if row is not None]
    path = ROOT / "docs" / "lunarlander_corrupted.npz"
    audit, faults = rpil.audit(path), rpil.check(path)
    assert len(audit.ids) == 20
    first = look_first(audit, [fault.id for fault in faults.findings])
    assert [int(name) for name, *_ in shown] == [audit.ids[m] for m in first]
    for name, verdict, log_odds in shown:
        m = audit.ids.index(int(name))
        assert verdict == audit.verdicts[m]
        # The last digits depend on the processor.
        assert float(log_odds) == pytest.approx(audit.log_odds[m], abs=0.1)
    assert any(" of 20 act differently" in text for text in texts)
