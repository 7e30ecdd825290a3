"""The report: audits as one HTML file that needs no network and no server."""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from rpil.data.files import replacing
from rpil.inference.findings import DECIDED, FINDINGS
from rpil.results.answering import NEXT_STEPS
from rpil.results.html.number_format import format_count, format_number, format_percent
from rpil.results.html.pictures import Timelines, inline_svg
from rpil.results.plots import HistoryDisplay, LengthDisplay
from rpil.results.result import AuditResult
from rpil.results.text import printable
from rpil.results.words import SIDES

MAX_TIMELINES = 200
"""Timelines on a page, those of the least trusted demonstrations: a page with more is slow to open."""


@dataclass(frozen=True, eq=False)
class Article:
    """One audit on a page; before its ranking, `sections` of a heading and a body, which is `Markup` or is escaped."""

    title: str
    audit: AuditResult
    source: str  # a file name or another name for the data
    summary: str = ""  # one sentence for the list of articles at the top of a page
    sections: Sequence[tuple[str, str | Markup]] = ()
    seconds: float | None = None  # duration of the audit


def html_environment(package: str, folder: str) -> Environment:
    """The environment of the Jinja templates in a folder of a package; what they insert is escaped and `printable`."""
    jinja = Environment(
        loader=PackageLoader(package, folder),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=lambda value: value if isinstance(value, Markup) else printable(value),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    jinja.filters |= {"number": format_number, "percent": format_percent, "count": format_count, "hash": _csp_hash}
    return jinja


def _csp_hash(code: str) -> Markup:
    """The hash by which a Content-Security-Policy allows the code of an element, and no other code."""
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    return Markup("'sha256-{}'").format(digest)


def render_page(articles: Sequence[Article], *, title: str = "", headline: str = "", introduction: str = "") -> str:
    """Audits as one self-contained HTML page, whose title is by default that of the first article.

    `headline` and `introduction` are a sentence, and a paragraph below it, for the top of a page of several articles.
    """
    environment = html_environment("rpil.results", "html")
    template = environment.get_template("article.html")
    rendered = []
    for k, article in enumerate(articles, start=1):
        # No two ids on a page are the same.
        level, prefix = (1, "") if len(articles) == 1 else (2, f"part-{k}-")
        html = template.render(_template_values(article.audit, prefix), article=article, prefix=prefix, level=level)
        rendered.append({"title": article.title, "summary": article.summary, "html": Markup(html)})
    return environment.get_template("page.html").render(
        title=title or articles[0].title,
        headline=headline,
        introduction=introduction,
        articles=rendered,
        vocabularies=list({one.audit.anchor: one.audit.words for one in articles}.values()),
        thresholds=list(
            dict.fromkeys((one.audit.words, one.audit.settings.min_proba(one.audit.anchor)) for one in articles)
        ),
    )


def write_page(path: str | os.PathLike[str], articles: Sequence[Article], **texts: str) -> None:
    """Write the page of `render_page` to `path`, which is replaced only once the new page is complete."""
    page = render_page(articles, **texts)
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", errors="backslashreplace") as stream:
        stream.write(page)


def _template_values(audit: AuditResult, prefix: str) -> dict[str, object]:
    """The values that article.html inserts; `prefix` starts every id."""
    parts, timelines, size = audit.evidence_columns(), Timelines(audit), (4.6, 3)
    reliability = "Reliability of each demonstration against its number of steps, coloured by verdict."
    objective = "The objective of each round."
    return {
        "audit": audit,
        "finding_sentence": FINDINGS[audit.finding],
        "next_step": NEXT_STEPS[audit.finding],
        "question": audit.question or "",
        "words": audit.words,
        "decided": audit.finding in DECIDED,
        "sides": SIDES,
        "parts": list(parts),
        "rows": _rows(audit, parts, timelines, prefix),
        "verdicts": audit.verdict_counts(),
        "n_steps": int(audit.offsets[-1]),
        "mean_weight": float(np.mean(audit.step_weight)),
        "n_rounds": len(audit.history),
        "groups": audit.groups,
        "scale": timelines,
        "length_picture": inline_svg(LengthDisplay(audit).plot, size, reliability, salt=f"{prefix}length"),
        "history_picture": inline_svg(HistoryDisplay(audit).plot, size, objective, salt=f"{prefix}history"),
    }


def _rows(
    audit: AuditResult, parts: Mapping[str, np.ndarray], timelines: Timelines, prefix: str
) -> list[dict[str, object]]:
    """The rows of the ranking, the most trusted first; `parts` are those of the log-odds."""
    letters = {name: letter for letter, group in audit.groups.items() for name in group}
    order = audit.ranking().tolist()
    return [
        {
            "anchor": f"{prefix}demonstration-{m}",
            "id": audit.ids[m],
            "rank": rank,
            "group": letters.get(audit.ids[m], ""),
            "verdict": audit.verdicts[m],
            "side": SIDES[audit.verdicts[m]],
            "reason": audit.reasons[m],
            "log_odds": float(audit.log_odds[m]),
            "parts": [float(part[m]) for part in parts.values()],
            "expert_proba": float(audit.expert_proba[m]),
            "reliability": float(audit.reliability[m]),
            "low": float(audit.reliability_interval[m, 0]),
            "high": float(audit.reliability_interval[m, 1]),
            "n_steps": int(audit.lengths[m]),
            "worst": audit.worst_steps(m),
            "timeline": timelines.timeline(m) if rank > len(order) - MAX_TIMELINES else None,
        }
        for rank, m in enumerate(order, start=1)
    ]
