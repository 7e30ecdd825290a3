"""An audit in about eight lines of text, or in a notebook: the finding, the words, the doubts, and the lowest ones."""

from __future__ import annotations

from html import escape

from rpil.data.text import counted, one_line
from rpil.inference.findings import FINDINGS
from rpil.results.result import AuditResult

N_LOWEST = 3
"""Demonstrations that the text names."""

N_LOWEST_ROWS = 10
"""Demonstrations that a notebook shows."""

MAX_NAME = 40
"""Characters of an id in the text."""


def overview_text(audit: AuditResult) -> str:
    """What ``repr`` of an audit is."""
    lines = [f"Audit: {audit.finding}. {FINDINGS[audit.finding]}", counts(audit)]
    if audit.doubts:
        more = len(audit.doubts) - 1
        lines.append(f"Doubt: {audit.doubts[0]}" + f" ({more} more in doubts)" * (more > 0))
    if audit.question:
        lines.append(f"Question: {audit.question}")
    lowest = audit.ranking()[::-1][:N_LOWEST].tolist()
    names = [shortened(audit.ids[m]) for m in lowest]
    width = max(map(len, names))
    lines.append(f"The lowest {len(lowest)} by log-odds, of {len(audit.ids):,}:")
    for m, name in zip(lowest, names, strict=True):
        lines.append(f"  {name:<{width}}  {audit.verdicts[m]}, {audit.place(m)}, log-odds {audit.log_odds[m]:+.1f}")
    return "\n".join([*lines, "All: to_frame(), plot.ranking(), to_html(path)."])


def counts(audit: AuditResult) -> str:
    """How many demonstrations and steps there are, and how many have which word, in one line."""
    words = ", ".join(f"{n:,} {word}" for word, n in audit.verdict_counts().items())
    return f"{counted(len(audit.ids), 'demonstration')}, {int(audit.offsets[-1]):,} steps: {words}."


def shortened(name: object) -> str:
    """An id in one short line."""
    text = one_line(name)
    return text if len(text) <= MAX_NAME else text[: MAX_NAME - 3] + "..."


def overview_html(audit: AuditResult) -> str:
    """What a notebook shows of an audit: the text, and a table of the lowest with their reasons."""
    lowest = audit.ranking()[::-1][:N_LOWEST_ROWS].tolist()
    rows = ([shortened(audit.ids[m]), audit.verdicts[m], audit.place(m), audit.reasons[m]] for m in lowest)
    cells = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows)
    return f"<pre>{escape(overview_text(audit))}</pre><table>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>"
