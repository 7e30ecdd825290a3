"""The reference on the site has all that is public, and the pages of the site are linked."""

from __future__ import annotations

import re
from pathlib import Path

import rpil

DOCS = Path(__file__).parents[2] / "docs"
MADE = {"gallery/index"}


def test_the_reference_has_the_public_names():
    text = (DOCS / "reference" / "api.md").read_text(encoding="utf-8")
    named = re.findall(r"^   rpil\.(\w+)$", text, re.MULTILINE)
    assert sorted(named) == sorted({*rpil.__all__} - {"__version__"})


def test_every_page_is_in_one_list_of_pages():
    listed: list[str] = []
    for page in DOCS.rglob("*.md"):
        for names in re.findall(r"^```\{toctree\}\n:hidden:\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S):
            for name in re.findall(r"^([\w/.*-]+)$", names, re.MULTILINE):
                if name not in MADE:
                    found = page.parent.glob(f"{name}.md") if "*" in name else [page.parent / f"{name}.md"]
                    listed += [path.resolve().relative_to(DOCS.resolve()).as_posix() for path in found]
    pages = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md") if "gallery" not in path.parts}
    assert sorted(listed) == sorted(pages - {"index.md"})


def test_links_to_files_lead_to_files():
    for page in DOCS.rglob("*.md"):
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[\w-]+)?\)", text):
            if "://" not in target and not target.startswith("gallery/"):
                assert (page.parent / target).exists(), (page.name, target)
