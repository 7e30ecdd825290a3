"""Names that come from data, as text that can be shown."""

from __future__ import annotations

import unicodedata


def printable(name: object) -> str:
    """The text of a name, with escapes in the place of characters that cannot be seen, such as control characters,
    marks that reverse the direction of writing, and lone surrogates, which no file can hold; lines and tabs stay."""
    text = str(name)
    return text if text.isprintable() else "".join(map(_escape_invisible, text))


def _escape_invisible(character: str) -> str:
    is_invisible = unicodedata.category(character).startswith("C") and character not in "\n\t"
    return character.encode("unicode_escape").decode("ascii") if is_invisible else character
