"""`Demonstrations` in a notebook: what they hold, and the first of them."""

from __future__ import annotations

from html import escape

from rpil.numerics.types import Array

N_ROWS = 5
"""Demonstrations in the table."""

MAX_NAMES = 8
"""Names of observations, or actions, in a line."""

MAX_TEXT = 40
"""Characters of a name."""


def demonstrations_html(
    summary: str, ids: tuple[object, ...], lengths: Array, observations: tuple[str, ...], actions: list[str]
) -> str:
    """The `summary`, a line each for observations and actions, and a table of the first demonstrations."""
    rows = "".join(
        f"<tr><td>{m}</td><td>{_text(name)}</td><td>{length:,}</td></tr>"
        for m, (name, length) in enumerate(zip(ids[:N_ROWS], lengths[:N_ROWS].tolist(), strict=True))
    )
    more = f"<p>and {len(ids) - N_ROWS:,} more</p>" if len(ids) > N_ROWS else ""
    head = "<tr><th></th><th>Demonstration</th><th>Steps</th></tr>"
    return (
        f"<p>{escape(summary)}</p><p>Observations: {_names(observations)}<br>Actions: {_names(actions)}</p>"
        f"<table><thead>{head}</thead><tbody>{rows}</tbody></table>{more}"
    )


def _names(names: tuple[str, ...] | list[str]) -> str:
    more = f" and {len(names) - MAX_NAMES:,} more" if len(names) > MAX_NAMES else ""
    return ", ".join(map(_text, names[:MAX_NAMES])) + more


def _text(name: object) -> str:
    """A name in one short line, escaped; what cannot be encoded is written as Python does."""
    text = " ".join(str(name).split())
    text = text if len(text) <= MAX_TEXT else text[: MAX_TEXT - 3] + "..."
    return escape(text.encode("utf-8", "backslashreplace").decode())
