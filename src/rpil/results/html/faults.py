"""The section of a report on recording faults."""

from __future__ import annotations

from markupsafe import Markup

from rpil.faults.record import FaultReport
from rpil.results.html.page import html_environment

MAX_FAULTS = 100
"""Findings in the table of a section, the worst."""


def faults_section(report: FaultReport) -> tuple[str, Markup]:
    """Heading and body for `rpil.results.html.page.Article.sections`."""
    template = html_environment("rpil.results", "html").get_template("faults.html")
    return "Recording faults", Markup(template.render(report=report, shown=report.findings[:MAX_FAULTS]))
