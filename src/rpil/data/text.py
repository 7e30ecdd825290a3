"""Names that come from data, and numbers of things, as text that can be shown, and as cells of tables.

A spreadsheet computes a cell that begins with ``=``, ``+``, ``-``, ``@``, a tab or a line's end, and a formula can send
data elsewhere (OWASP, CSV injection). So tables get an apostrophe before such a text, and reading removes it. Plain
numbers, such as -5, stay what they are.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any
from unicodedata import category

if TYPE_CHECKING:
    import pyarrow as pa

MAX_LISTED_NAMES, MAX_IDS = 5, 20
"""Names in one sentence, and ids in one printed line."""

_PATH = r"(?<![\w.:])(?<!:/)"  # before a path, and not before the name of a bucket in an address


def printable(name: object, kept: str = "") -> str:
    """The text of a name, with escapes in the place of characters that cannot be seen, such as control characters,
    marks that reverse the direction of writing, and lone surrogates, which no file can hold; those in `kept` stay."""
    return "".join(sign if sign in kept or category(sign)[0] != "C" else repr(sign)[1:-1] for sign in str(name))


def one_line(name: object) -> str:
    """The `printable` text of a name with spaces in the place of lines and tabs."""
    return " ".join(printable(name, kept="\n\t").split())


def listed(names: Iterable[object], most: int = MAX_LISTED_NAMES, last: str = " and ") -> str:
    """Up to `most` of the names in one line, with `last` before the last one, and how many more there are."""
    texts = [printable(name) or "no name" for name in names]
    if len(texts) > most:
        return f"{', '.join(texts[:most])} and {len(texts) - most:,} more"
    return last.join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)


def counted(size: int, noun: str) -> str:
    """``1 step``, ``2,000 steps``."""
    return f"{size:,} {noun}{'' if size == 1 else 's'}"


def duration(steps: float, seconds: float | None) -> str:
    """The time that steps take, at so many `seconds` each, as ``4.2 s``; where these are unknown ``85 steps``."""
    if seconds is None:
        return counted(round(steps), "step")
    time = steps * seconds
    return f"{time:.1f} s" if time >= 1 else f"{time:.2f} s"


def moment(step: int, seconds: float | None) -> str:
    """When a step is, from the first on: ``49.8 s``, or ``step 995``."""
    return f"step {step}" if seconds is None else duration(step, seconds)


def for_others(text: str) -> str:
    """The text with ``~`` for the home folder and without those of others, for reports, which are passed on."""
    home = os.path.expanduser("~")
    text = text if home == "/" else re.sub(rf"{_PATH}{re.escape(home)}(?![\w.-])", "~", text)
    return re.sub(rf"{_PATH}/(?:home|Users)/[^/\s'\"]+", "...", text)


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


DataFrame = Any
"""A frame of pandas, which need not be installed, or a table of pyarrow."""


def data_frame(columns: Mapping[str, Sequence[object]]) -> DataFrame:
    """The columns as a data frame of pandas, or where that is not installed as a table of pyarrow."""
    lists = {name: list(values) for name, values in columns.items()}
    try:
        return import_module("pandas").DataFrame(lists)
    except ImportError:
        return import_module("pyarrow").table(lists)
