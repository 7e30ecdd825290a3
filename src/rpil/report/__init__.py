"""One HTML file that tells a reader which demonstrations to trust; it needs no network and no server."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from rpil.audit import Audit
from rpil.files import replacing
from rpil.judge import FINDINGS
from rpil.plots import HistoryDisplay, LengthDisplay
from rpil.report.pictures import Timelines, inline_svg, returns_figure, score_figure
from rpil.report.wording import count, number, percent
from rpil.suggestions import NEXT, P_EXPERT

__all__ = ["Part", "render", "render_many", "returns_figure", "score_figure", "summarise", "write", "write_many"]

# A page with more timelines than this is slow to open; the least trusted demonstrations are the ones to look at.
MOST_TIMELINES = 200


@dataclass(frozen=True, eq=False)
class Part:
    """One audit on a page that holds several.

    Attributes
    ----------
    title, source : str
        As `render` takes them.
    audit : Audit
    summary : str
        One sentence for the head of the page, which leads to this part.
    sections : sequence of (heading, body)
        As `render` takes them.
    seconds : float, optional
        How long the audit took.
    """

    title: str
    audit: Audit
    source: str
    summary: str = ""
    sections: Sequence[tuple[str, str | Markup]] = ()
    seconds: float | None = None


def render(
    audit: Audit,
    *,
    title: str,
    source: str,
    seconds: float | None = None,
    sections: Sequence[tuple[str, str | Markup]] = (),
) -> str:
    """The report as one self-contained HTML page.

    Parameters
    ----------
    audit : Audit
    title : str
    source : str
        Where the demonstrations came from: a file name or another name for the data.
    seconds : float, optional
        How long the audit took.
    sections : sequence of (heading, body)
        Blocks to show before the ranking; a body that is `Markup` is taken as HTML, any other text is escaped.
    """
    part = Part(title, audit, source, sections=sections, seconds=seconds)
    return _page([part], [""], title=title, level=1)


def render_many(parts: Sequence[Part], *, title: str, headline: str, lead: str = "") -> str:
    """Several audits as one self-contained HTML page.

    Parameters
    ----------
    parts : sequence of Part
        In the order of the page.
    title, headline : str
        What the page is, and what it says in a sentence.
    lead : str
        A paragraph below the headline.
    """
    prefixes = [f"part-{k}-" for k in range(1, len(parts) + 1)]
    return _page(parts, prefixes, title=title, level=2, headline=headline, lead=lead)


def write(
    path: str | os.PathLike[str],
    audit: Audit,
    *,
    title: str,
    source: str,
    seconds: float | None = None,
    sections: Sequence[tuple[str, str | Markup]] = (),
) -> None:
    """Write what `render` returns to `path`, which is replaced only once the new report is complete."""
    _save(path, render(audit, title=title, source=source, seconds=seconds, sections=sections))


def write_many(
    path: str | os.PathLike[str], parts: Sequence[Part], *, title: str, headline: str, lead: str = ""
) -> None:
    """Write what `render_many` returns to `path`, which is replaced only once the new report is complete."""
    _save(path, render_many(parts, title=title, headline=headline, lead=lead))


def _save(path: str | os.PathLike[str], page: str) -> None:
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8") as stream:
        stream.write(page)


def _page(
    parts: Sequence[Part], prefixes: Sequence[str], *, title: str, level: int, headline: str = "", lead: str = ""
) -> str:
    """Each part under headings that start at `level`, its ids prefixed so that no two on the page are the same."""
    environment = Environment(
        loader=PackageLoader("rpil", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "percent": percent, "count": count}
    article = environment.get_template("audit.html")
    shown = [
        {
            "title": part.title,
            "summary": part.summary,
            "html": Markup(
                article.render(
                    summarise(part.audit, prefix),
                    title=part.title,
                    source=part.source,
                    seconds=part.seconds,
                    sections=part.sections,
                    prefix=prefix,
                    level=level,
                )
            ),
        }
        for part, prefix in zip(parts, prefixes, strict=True)
    ]
    return environment.get_template("template.html").render(title=title, headline=headline, lead=lead, parts=shown)


def summarise(audit: Audit, prefix: str = "") -> dict[str, Any]:
    """All that the page shows of an audit, as plain values, texts and pictures; `prefix` starts every id."""
    order = audit.ranking()
    timelines = Timelines(audit)
    # The group of a demonstration, A or B, in the order of `competing`.
    groups = {name: "AB"[g] for g, members in enumerate(audit.competing) for name in members}
    parts = {name: part for name, part in audit.evidence.items() if part.any()}
    if len(parts) == 1:
        parts = {}  # it is the log-odds
    rows = [
        {
            "rank": rank,
            "anchor": f"{prefix}demonstration-{m}",
            "id": audit.ids[m],
            "group": groups.get(audit.ids[m], ""),
            "verdict": audit.verdicts[m],
            "log_odds": float(audit.log_odds[m]),
            "parts": [float(part[m]) for part in parts.values()],
            "expert_proba": float(audit.expert_proba[m]),
            "reliability": float(audit.reliability[m]),
            "low": float(audit.reliability_interval[m, 0]),
            "high": float(audit.reliability_interval[m, 1]),
            "steps": int(audit.lengths[m]),
            "worst": audit.worst_steps(m),
            "timeline": timelines.one(m) if rank > len(order) - MOST_TIMELINES else None,
        }
        for rank, m in enumerate(map(int, order), start=1)
    ]
    return {
        "finding": audit.finding,
        "finding_says": FINDINGS[audit.finding],
        "next": NEXT[audit.finding],
        "p_expert": P_EXPERT,
        "labelled": audit.labelled,
        "parts": list(parts),
        "rows": rows,
        "verdicts": {verdict: audit.verdicts.count(verdict) for verdict in ("expert", "uncertain", "adversary")},
        "steps": int(audit.offsets[-1]),
        "weight": float(np.mean(audit.step_weight)),
        "prior": audit.prior,
        "adversary": audit.adversary,
        "iterations": len(audit.history),
        "identifiable": audit.identifiable,
        "groups": [{"letter": "AB"[g], "ids": members} for g, members in enumerate(audit.competing)],
        "to_label": audit.to_label,
        "demonstrators": audit.demonstrators,
        "scale": timelines,
        "length_picture": inline_svg(
            LengthDisplay(audit).plot,
            size=(4.6, 3),
            label="Reliability of each demonstration against its number of steps, coloured by verdict.",
            salt=f"{prefix}length",
        ),
        "history_picture": inline_svg(
            HistoryDisplay(audit).plot,
            size=(4.6, 3),
            label="The objective of each round.",
            salt=f"{prefix}history",
        ),
        "assumptions": audit.assumptions,
    }
