"""An audit in a notebook: the finding, a bar of the words, and the lowest ten."""

from __future__ import annotations

from rpil.inference.findings import FINDINGS
from rpil.results.html.page import html_environment
from rpil.results.overview import counts, shortened
from rpil.results.plots import COLOURS
from rpil.results.result import AuditResult
from rpil.results.words import SIDES

N_LOWEST_ROWS = 10
"""Demonstrations in the table."""


def overview_html(audit: AuditResult) -> str:
    """What a notebook shows of an audit; styles are within its elements, because a notebook may drop style sheets."""
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
