"""Pages stay short: code, formulas and addresses are not counted as words."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")]
PAGES = [page for page in PAGES if not {"gallery", "generated"} & set(page.parts)]
LONGER = {"faults.md": 5_000, "formats.md": 1_700}
MOST, MOST_OF_ALL = 1_500, 28_000


def n_words(text: str) -> int:
    """Words of a page: what has a letter or a digit, outside blocks of code, formulas and addresses."""
    skipped = r"^```.*?^```|\$\$.*?\$\$|\$[^$\n]+\$|\]\([^)]*\)|^\[[^\]\n]+\]: [^\n]*$"
    text = re.sub(skipped, " ", text, flags=re.M | re.S)
    return sum(re.search(r"\w", word) is not None for word in text.split())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_is_short(page):
    assert n_words(page.read_text(encoding="utf-8")) <= LONGER.get(page.name, MOST)


def test_all_pages_together_are_short():
    assert sum(n_words(page.read_text(encoding="utf-8")) for page in PAGES) <= MOST_OF_ALL


def test_code_and_formulas_are_no_words():
    code, math = "```python\nx = 1\n```", "$$a + b$$ three $c$ [four](five.md) | - |"
    assert n_words(f"One two\n\n{code}\n\n{math}\n\n[Five] six\n\n[six]: https://seven\n") == 6
