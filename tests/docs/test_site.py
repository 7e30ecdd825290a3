"""The pages of the site: short, linked, with all that is public; docs/python.md runs and prints what it says."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import matplotlib
import pytest

import rpil
from rpil.results.plots import AuditPlots

ROOT = Path(__file__).parents[2]
DOCS, MADE = ROOT / "docs", {"gallery/index"}
ALL = [page for page in DOCS.rglob("*.md") if not {"gallery", "generated"} & set(page.parts)]
TEXTS = {page: page.read_text(encoding="utf-8") for page in (ROOT / "README.md", ROOT / "CHANGELOG.md", *ALL)}
LONGER = {"faults.md": 3_550, "formats.md": 1_300}
MOST, MOST_OF_ALL = 1_500, 25_000


def n_words(text: str) -> int:
    """Words of a page: what has a letter or a digit, outside blocks of code, formulas and addresses."""
    skipped = r"^```.*?^```|\$\$.*?\$\$|\$[^$\n]+\$|\]\([^)]*\)|^\[[^\]\n]+\]: [^\n]*$"
    text = re.sub(skipped, " ", text, flags=re.M | re.S)
    return sum(re.search(r"\w", word) is not None for word in text.split())


def test_each_page_is_short_and_so_are_all():
    found = {str(page): n_words(text) for page, text in TEXTS.items()}
    assert [name for name, n in found.items() if n > LONGER.get(Path(name).name, MOST)] == []
    assert sum(found.values()) <= MOST_OF_ALL
    code, math = "```python\nx = 1\n```", "$$a + b$$ three $c$ [four](five.md) | - |"
    assert n_words(f"One two\n\n{code}\n\n{math}\n\n[Five] six\n\n[six]: https://seven\n") == 6


def test_the_reference_has_the_public_names():
    named = re.findall(r"^   rpil\.(\w+)$", TEXTS[DOCS / "reference" / "api.md"], re.MULTILINE)
    assert sorted(named) == sorted({*rpil.__all__} - {"__version__"})


def test_every_page_is_in_one_list_of_pages():
    listed: list[str] = []
    for page in ALL:
        for names in re.findall(r"^```\{toctree\}\n:hidden:\n(.*?)^```", TEXTS[page], re.M | re.S):
            for name in re.findall(r"^([\w/.*-]+)$", names, re.MULTILINE):
                if name not in MADE:
                    found = page.parent.glob(f"{name}.md") if "*" in name else [page.parent / f"{name}.md"]
                    listed += [path.resolve().relative_to(DOCS.resolve()).as_posix() for path in found]
    assert sorted(listed) == sorted({path.relative_to(DOCS).as_posix() for path in ALL} - {"index.md"})


def test_links_to_files_lead_to_files():
    for page in ALL:
        text = re.sub(r"```.*?```", "", TEXTS[page], flags=re.DOTALL)
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[\w-]+)?\)", text):
            if "://" not in target and not target.startswith("gallery/"):
                assert (page.parent / target).exists(), (page.name, target)


@pytest.mark.slow
def test_the_code_of_the_python_page_runs_and_prints_what_it_says(tmp_path):
    text = TEXTS[DOCS / "python.md"]
    named = set(re.findall(r"audit\.plot\.(\w+)", text))
    assert named == {name for name in vars(AuditPlots) if not name.startswith("_") and name != "audit"}
    matplotlib.use("Agg")
    assert runpy.run_path(str(ROOT / "tools" / "tutorials.py"))["run"](DOCS / "python.md", tmp_path) == []
    assert {path.name for path in tmp_path.iterdir()} == {"audit.html", "steps.png"}
