"""docs/value.md has the figures of docs/results.md, and the README those of docs/value.md."""

from __future__ import annotations

from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def rows(text: str) -> list[list[str]]:
    """The cells of the rows of all tables, without headers."""
    lines = [line.strip().strip("|").split("|") for line in text.splitlines() if line.startswith("|")]
    found = [[cell.strip() for cell in line] for line in lines]
    return [row for row in found if row[0] != "rule" and not row[0].startswith("--")]


def test_every_figure_stands_in_the_results_of_the_same_rule():
    policies = (DOCS / "results.md").read_text(encoding="utf-8").partition("## Policies")[2]
    printed: dict[str, list[str]] = {}
    for rule, *figures in rows(policies):
        printed.setdefault(rule, []).extend(figures)
    table = rows((DOCS / "value.md").read_text(encoding="utf-8"))
    assert len(table) >= 8
    for rule, *figures in table:
        for figure in filter(None, (part for cell in figures for part in cell.split(" ± "))):
            assert figure in printed[rule], (rule, figure)


def test_the_readme_has_rows_of_the_first_table():
    """Without the columns of the games."""
    first = (DOCS / "value.md").read_text(encoding="utf-8").partition("**A linear policy learns**")[0]
    arm = {rule: [ten, fifty, minus] for rule, ten, fifty, minus, *_ in rows(first)}
    table = [row for row in rows((DOCS.parent / "README.md").read_text(encoding="utf-8")) if row[0] in arm]
    assert [rule for rule, *_ in table] == ["all", "keep", "step weights", "8 suggested labels", "oracle"]
    for rule, *figures in table:
        assert figures == arm[rule]
