"""Names that come from data, as text that can be shown."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

MAX_LISTED_NAMES = 5
"""Names in one sentence."""


def printable(name: object) -> str:
    """The text of a name, with escapes in the place of characters that cannot be seen, such as control characters,
    marks that reverse the direction of writing, and lone surrogates, which no file can hold; lines and tabs stay."""
    text = str(name)
    return text if text.isprintable() else "".join(map(_escape_invisible, text))


def one_line(name: object) -> str:
    """The `printable` text of a name with spaces in the place of lines and tabs."""
    return " ".join(printable(name).split())


def listed(names: Sequence[object], most: int = MAX_LISTED_NAMES) -> str:
    """Some names in one line, and how many more there are."""
    texts = [printable(name) for name in names[:most]]
    if len(names) > most:
        texts.append(f"{len(names) - most:,} more")
    return " and ".join(part for part in (", ".join(texts[:-1]), texts[-1]) if part)


def _escape_invisible(character: str) -> str:
    is_invisible = unicodedata.category(character).startswith("C") and character not in "\n\t"
    return character.encode("unicode_escape").decode("ascii") if is_invisible else character
