"""An audit in about eight lines of text, or in a notebook: finding, verdicts, doubts, and the lowest scores."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from html import escape

from rpil.data.text import MAX_IDS, counted, listed, one_line, printable
from rpil.inference.findings import FINDINGS
from rpil.results.result import AuditResult
from rpil.results.vocabulary import SIDES, numbered

N_LOWEST = 3
"""Demonstrations that the text names."""

N_LOWEST_ROWS = 10
"""Demonstrations that a notebook shows."""

MAX_NAME = 40
"""Characters of an id in the text."""


def headline(audit: AuditResult, most: int = MAX_IDS, named: Callable[[Hashable], str] = printable) -> str:
    """The finding in one sentence, with numbers and up to `most` names, the lowest score first."""
    n, counts = len(audit.ids), audit.verdict_counts()
    lower = [m for m in audit.ranking()[::-1].tolist() if SIDES[audit.verdicts[m]] == "lower"]

    def names_of(verdict: str = "") -> str:
        own = [named(audit.ids[m]) for m in lower if audit.verdicts[m] == verdict or not verdict]
        return listed(own, most, ", ")

    if audit.finding == "outliers" and lower:
        return f"{len(lower):,} of {n:,} act{'s' * (len(lower) == 1)} differently from the rest: {names_of()}."
    if audit.finding == "answered":
        said = (
            numbered(size, one) + f" ({names_of(one)})" * (SIDES[one] == "lower" and size > 0)
            for one, size in counts.items()
        )
        return f"By your answers: {', '.join(said)}."
    if audit.finding == "mixture" and lower:
        return f"{len(lower):,} of {n:,} act{'s' * (len(lower) == 1)} like the adversary that was named: {names_of()}."
    sentence = FINDINGS[audit.finding]
    if audit.finding == "two groups" and audit.groups:
        sizes = " and ".join(f"{len(ids):,}" for ids in audit.groups.values())
        return f"Two groups act differently: {sizes}{sentence.removeprefix('Two groups act differently')}"
    if audit.finding in ("two groups", "outliers"):
        return sentence
    return f"{audit.finding.capitalize()}: {sentence[:1].lower()}{sentence[1:]}"


def overview_text(audit: AuditResult) -> str:
    """What ``repr`` of an audit is."""
    lines = [f"Audit: {headline(audit)}", counts(audit)]
    if audit.doubts:
        more = len(audit.doubts) - 1
        lines.append(f"Doubt: {audit.doubts[0]}" + f" ({more} more in doubts)" * (more > 0))
    if audit.question:
        lines.append(f"Question: {audit.question}")
    lowest = audit.ranking()[::-1][:N_LOWEST].tolist()
    names = [shortened(audit.ids[m]) for m in lowest]
    width = max(map(len, names))
    lines.append(f"The lowest {len(lowest)} scores (log_odds), of {len(audit.ids):,}:")
    for m, name in zip(lowest, names, strict=True):
        lines.append(f"  {name:<{width}}  {audit.verdicts[m]}, {audit.place(m)}, score {audit.log_odds[m]:+.1f}")
    return "\n".join([*lines, "All: to_frame(), plot.ranking(), to_html(path)."])


def counts(audit: AuditResult) -> str:
    """How many demonstrations and steps there are, and how many have which verdict, in one line."""
    words = ", ".join(numbered(n, verdict) for verdict, n in audit.verdict_counts().items())
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
