"""Figures say which commit they are of: a page whose header names one has tables of no other."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [page for page in (ROOT / "docs").rglob("*.md") if not {"gallery", "generated"} & set(page.parts)]
OUTSIDE = [ROOT / "docs" / "outside.md", ROOT / "benchmarks" / "outside" / "tables.md"]
COMMIT = re.compile(r"\bcommits?\s+`?([0-9a-f]{7,40}\b\+?)((?:(?:,| to| and)\s+`?[0-9a-f]{7,40}\b)*)", re.I)


def commits(text: str) -> list[str]:
    """All commits that a text names, in its order."""
    return [each for own, more in COMMIT.findall(text) for each in [own, *re.findall(r"[0-9a-f]{7,40}", more)]]


def others_than_the_header(text: str) -> list[str]:
    """Commits of a page that are not the first of its header, which ends at the first section; no header, none."""
    header = commits(text.partition("\n## ")[0])
    same = [each for each in commits(text) if header and (each.startswith(header[0]) or header[0].startswith(each))]
    return [each for each in commits(text) if header and each not in same]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_header_names_the_commit_of_all_tables(page):
    assert others_than_the_header(page.read_text(encoding="utf-8")) == []


def test_another_commit_than_that_of_the_header_is_found():
    page = "# Title\n\nCommit 0123456789ab.\n\n## Table\n\n| a |\n\n*{}, 2026-01-02.*\n"
    assert others_than_the_header(page.format("commit `0123456789ab`")) == []
    assert others_than_the_header(page.format("commit fedcba987654")) == ["fedcba987654"]
    assert others_than_the_header("Commits 9d883b35 to 06ed4ab6, worlds of another.") == ["06ed4ab6"]
    assert others_than_the_header("# Title\n\n## One\n\n*commit 0123456*\n\n## Two\n\n*commit fedcba9*\n") == []


def test_outside_worlds_are_of_one_clean_commit_on_both_pages():
    named = {each for page in OUTSIDE for each in commits(page.read_text(encoding="utf-8"))}
    assert len(named) == 1
    assert not named.pop().endswith("+")


def test_readme_has_the_worst_cell_of_the_learner():
    table, readme = OUTSIDE[0].read_text(encoding="utf-8"), (ROOT / "README.md").read_text(encoding="utf-8")
    found = re.search(r"^\| RPIL\(\) weights \| ([+-][\d.]+) \|", table, re.M)
    said = re.search(r"its worst policy is (\d+) points below one", readme)
    assert found
    assert said
    assert round(-float(found[1])) == int(said[1])
