"""docs/formats.md lists every format of the registry, as it is there, and each has a page of its own."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rpil.formats.format import Format
from rpil.formats.registry import known_formats

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "formats.md").read_text(encoding="utf-8")
DEFECTS = {"LeRobot": "compares the folder with itself", "JSON lines": "finds missing files that rows name"}
NEEDED = {"arrays": "hdf5"}
"""The extras without which a format is not read."""


def row(one: Format) -> str:
    """The line of the table; the page's name is not in the registry."""
    suffixes = ", ".join(f"`{suffix}`" for suffix in one.suffixes)
    can = {
        f"`rpil convert -o NEW{one.suffixes[0] if one.suffixes else ''}`": one.write,
        f"`rpil check` {DEFECTS.get(one.name)}": one.find_defects,
    }
    return f"| {suffixes} | {'; '.join(name for name, function in can.items() if function is not None)} |"


def test_the_table_is_that_of_the_registry():
    lines = re.findall(r"^\| \[(.+?)\]\((formats/[\w-]+\.md)\) \|(.*)\|(.*)\|(.*)\|$", TEXT, re.MULTILINE)
    assert {name for name, _, _, kept, _ in lines if kept.strip() == "the list"} == {
        one.name for one in known_formats() if one.keep is None
    }
    found = [(name, place, f"|{suffixes}|{more}|") for name, place, suffixes, _, more in lines]
    wanted = [(one.name, row(one)) for one in known_formats()]
    assert [(name, " ".join(rest.split())) for name, _, rest in found] == [
        (name, " ".join(rest.split())) for name, rest in wanted
    ], "\n".join(f"| [{name}]() {rest}" for name, rest in wanted)


@pytest.mark.parametrize("one", list(known_formats()), ids=lambda one: one.name)
def test_the_page_of_a_format(one):
    (place,) = re.findall(rf"^\| \[{re.escape(one.name)}\]\((.+?)\)", TEXT, re.MULTILINE)
    page = (DOCS / place).read_text(encoding="utf-8")
    assert re.search(r"^## (Pitfalls|Limits)$", page, re.MULTILINE), "limits"
    assert re.search(r"rpil keep|What is kept back", page), "what is kept back"
    assert "rpil info" in page
    for suffix in one.suffixes:
        assert suffix in page
    if one.name in NEEDED:
        assert f"pip install 'rpil[{NEEDED[one.name]}]'" in page


def test_every_page_is_linked():
    pages = {f"formats/{path.name}" for path in (DOCS / "formats").glob("*.md")}
    assert pages == set(re.findall(r"\((formats/[\w-]+\.md)\)", TEXT))
