"""`Demonstrations` in a notebook: what they hold, and the first of them."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Protocol

from rpil.data.arrays import Id
from rpil.numerics.types import Array

N_LISTED = 5
"""Demonstrations in the table."""

MAX_IN_LINE = 8
"""Names of observations, or actions, in a line."""

MAX_LABEL = 40
"""Characters of a name."""


class Shown(Protocol):
    """What this module reads of `rpil.data.demonstrations.Demonstrations`."""

    @property
    def ids(self) -> tuple[Id, ...]: ...
    @property
    def lengths(self) -> Array: ...
    @property
    def observation_names(self) -> tuple[str, ...]: ...
    @property
    def action_names(self) -> tuple[str, ...]: ...
    @property
    def n_actions(self) -> int: ...
    @property
    def classes(self) -> Array: ...
    @property
    def low(self) -> Array: ...
    @property
    def high(self) -> Array: ...


def demonstrations_html(shown: Shown) -> str:
    """The ``repr``, a line each for observations and actions, and a table of the first demonstrations."""
    n, first = len(shown.ids), zip(shown.ids[:N_LISTED], shown.lengths[:N_LISTED].tolist(), strict=True)
    rows = "".join(
        f"<tr><td>{m}</td><td>{_text(name)}</td><td>{length:,}</td></tr>" for m, (name, length) in enumerate(first)
    )
    more = f"<p>and {n - N_LISTED:,} more</p>" if n > N_LISTED else ""
    head = "<tr><th></th><th>Demonstration</th><th>Steps</th></tr>"
    return (
        f"<p>{escape(repr(shown))}</p>"
        f"<p>Observations: {_names(shown.observation_names)}<br>Actions: {_names(_actions(shown))}</p>"
        f"<table><thead>{head}</thead><tbody>{rows}</tbody></table>{more}"
    )


def _actions(shown: Shown) -> Sequence[object]:
    """The discrete actions, or each part of continuous ones with its range."""
    if not shown.n_actions:
        return list(shown.classes.tolist())
    names = shown.action_names or tuple(map(str, range(shown.n_actions)))
    ranges = zip(names, shown.low, shown.high, strict=True)
    return [f"{name} from {low:.4g} to {high:.4g}" for name, low, high in ranges]


def _names(names: Sequence[object]) -> str:
    more = f" and {len(names) - MAX_IN_LINE:,} more" if len(names) > MAX_IN_LINE else ""
    return ", ".join(map(_text, names[:MAX_IN_LINE])) + more


def _text(name: object) -> str:
    """A name in one short line, escaped; what cannot be encoded is written as Python does."""
    text = " ".join(str(name).split())
    text = text if len(text) <= MAX_LABEL else text[: MAX_LABEL - 3] + "..."
    return escape(text.encode("utf-8", "backslashreplace").decode())
