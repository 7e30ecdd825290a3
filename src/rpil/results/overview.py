"""An audit in about eight lines of text, or in a notebook: the finding, the words, the doubts, and the lowest ones."""

from __future__ import annotations

from rpil.data.text import counted, one_line
from rpil.inference.findings import FINDINGS
from rpil.results.result import AuditResult
from rpil.results.words import COLOURS, SIDES

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
    """What a notebook shows of an audit; styles are within its elements, because a notebook may drop style sheets."""
    from rpil.results.html.page import html_environment

    colours = {word: COLOURS[SIDES[word]] for word in audit.verdict_counts()}
    rows = [
        {
            "id": shortened(audit.ids[m]),
            "verdict": audit.verdicts[m],
            "colour": colours[audit.verdicts[m]],
            "place": audit.place(m),
            "log_odds": f"{audit.log_odds[m]:+.1f}",
            "n_steps": f"{audit.lengths[m]:,}",
            "reason": audit.reasons[m],
        }
        for m in audit.ranking()[::-1][:N_LOWEST_ROWS].tolist()
    ]
    return (
        html_environment("rpil.results", "html")
        .get_template("overview.html")
        .render(
            audit=audit,
            sentence=FINDINGS[audit.finding],
            counts=counts(audit),
            words=audit.verdict_counts(),
            colours=colours,
            question=audit.question or "",
            rows=rows,
            n=len(audit.ids),
        )
    )
