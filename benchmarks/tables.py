"""Tables in Markdown, their best figures bold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence


def table(header: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 1) -> str:
    """A Markdown table; all columns after the first `text_columns` are aligned to the right."""
    rule = ["---"] * text_columns + ["---:"] * (len(header) - text_columns)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, rule, *rows))


def bold_best(cells: Sequence[str], values: Sequence[float | None], digits: int = 2) -> list[str]:
    """The cells, bold where the value is the largest; all that print like the largest are. None takes no part."""
    known = [round(value, digits) for value in values if value is not None]
    best = max(known, default=None)
    return [
        f"**{cell}**" if value is not None and round(value, digits) == best else cell
        for cell, value in zip(cells, values, strict=True)
    ]


def by_column(names: Sequence[str], cells: Mapping[str, Sequence[tuple[str, float | None]]], digits: int = 2) -> str:
    """A row of (text, value) for each key, a column for each name; the best of each column is bold."""
    columns = [
        bold_best([text for text, _ in column], [value for _, value in column], digits)
        for column in zip(*cells.values(), strict=True)
    ]
    return table(["", *names], [list(row) for row in zip(cells, *columns, strict=True)])


def bullets(lines: Iterable[str]) -> str:
    return "\n".join(f"- {line}" for line in lines)


def and_list(items: Sequence[str]) -> str:
    """``a, b and c``."""
    return " and ".join([", ".join(items[:-1]), items[-1]]) if len(items) > 1 else "".join(items)
