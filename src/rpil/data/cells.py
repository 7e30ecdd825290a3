"""Text in the cells of CSV tables that a spreadsheet would take for a formula.

A spreadsheet computes a cell that begins with ``=``, ``+``, ``-``, ``@``, a tab or a line's end, and a formula can send
data elsewhere (OWASP, CSV injection). So tables get an apostrophe before such a text, and reading removes it. Plain
numbers, such as -5, stay what they are.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow as pa

_PLAIN_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\Z"
# A text of apostrophes and then a formula gets one more, so that removing one always gives the text.
_FORMULA = re.compile(rf"'*(?!{_PLAIN_NUMBER})[=+\-@\t\r\n＝＋－＠]")


def to_cell(value: object) -> object:
    """The value, with an apostrophe before text that would be a formula."""
    return f"'{value}" if isinstance(value, str) and _FORMULA.match(value) else value


def from_cell(text: str) -> str:
    """The text that `to_cell` made a cell of."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text[1:]) else text


def each_text(change: Callable[[str], object], column: pa.ChunkedArray) -> pa.ChunkedArray:
    """A column with its texts changed, and any other column as it is; each different text is looked at once."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if not (pa.types.is_string(column.type) or pa.types.is_large_string(column.type)):
        return column
    old = column.unique().drop_null()
    new = pa.array([change(text) for text in old.to_pylist()], column.type)
    if new.equals(old):
        return column
    return pa.chunked_array([new.take(pc.index_in(column, old).combine_chunks())])
