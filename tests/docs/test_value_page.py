"""docs/value.md has the figures of docs/results.md."""

from __future__ import annotations

from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def rows(text: str) -> list[list[str]]:
    """The cells of the rows of all tables, without headers."""
    lines = [line.strip().strip("|").split("|") for line in text.splitlines() if line.startswith("|")]
    found = [[cell.strip() for cell in line] for line in lines]
    headers = {found[k - 1][0] for k, row in enumerate(found) if row[0].startswith("--")}
    return [row for row in found if row[0] not in headers and not row[0].startswith("--")]


def test_every_row_stands_in_the_results():
    printed = rows((DOCS / "results.md").read_text(encoding="utf-8").partition("## Policies")[2])
    table = rows((DOCS / "value.md").read_text(encoding="utf-8"))
    assert len(table) >= 20
    assert all(row in printed for row in table)
