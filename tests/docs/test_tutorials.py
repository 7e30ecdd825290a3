"""Every block of every tutorial runs and prints what the page says, and every finding is explained."""

import json
import re
import runpy
from pathlib import Path

import matplotlib
import pytest

from rpil.inference.findings import FINDINGS
from study.tables import compared

ROOT = Path(__file__).parents[2]
TUTORIALS = ROOT / "docs" / "tutorials"
TOOL = runpy.run_path(str(ROOT / "tools" / "tutorials.py"))
PAGES = sorted(page.name for page in TUTORIALS.glob("*.md") if page.name != "index.md")


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # commands warn where a user may overlook it
@pytest.mark.parametrize("name", PAGES)
def test_the_blocks_run_and_print_what_the_page_says(name, tmp_path):
    if "make_episodes.py" in (TUTORIALS / name).read_text(encoding="utf-8"):
        pytest.importorskip("av", reason="PyAV is not installed: pip install 'rpil[video]'")
    matplotlib.use("agg")
    assert TOOL["run"](TUTORIALS / name, tmp_path) == []
    for picture in TOOL["pictures"](TUTORIALS / name):
        assert (tmp_path / picture).stat().st_size > 1_000


def test_every_finding_has_its_section_and_its_sentence():
    text = (TUTORIALS / "findings.md").read_text(encoding="utf-8")
    sections = {title.lower(): body for title, body in re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", text, re.M | re.S)}
    assert set(sections) == set(FINDINGS)
    for finding, body in sections.items():
        quoted = " ".join(line[1:].strip() for line in body.splitlines() if line.startswith(">"))
        assert quoted == FINDINGS[finding]
        assert "**It means:**" in body
        assert "**Do this:**" in body
        assert re.search(rf"```text\n{finding}: ", body)


def test_every_tutorial_is_in_the_list_and_pictures_are_there_and_small():
    named = [picture for name in PAGES for picture in TOOL["pictures"](TUTORIALS / name)]
    assert sorted(named) == sorted(path.name for path in TUTORIALS.glob("*.png"))
    assert all((TUTORIALS / name).stat().st_size < 100_000 for name in named)
    text = (TUTORIALS / "index.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^- \[.*?\]\((.*?)\)", text, re.MULTILINE)) == PAGES
    assert sorted(f"{name}.md" for name in re.findall(r"^[\w-]+$", text.partition(":hidden:")[2], re.M)) == PAGES


def test_the_papers_tables_are_those_of_the_figures():
    """docs/figures/paper.json is what `make paper` wrote, without its single draws."""
    figures = json.loads((ROOT / "docs" / "figures" / "paper.json").read_text(encoding="utf-8"))
    page = (TUTORIALS / "baseline.md").read_text(encoding="utf-8")
    assert compared(figures) in page
    assert figures["provenance"]["commit"] in page
    assert f"{figures['tables'][0]['draws']} draws" in page
