"""One HTML file that tells a reader which demonstrations to trust; it needs no network and no server."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from rpil.audit.assumptions import P_EXPERT
from rpil.audit.html.pictures import Timelines, inline_svg
from rpil.audit.html.wording import count, number, percent
from rpil.audit.label_choice import NEXT_STEPS
from rpil.audit.plots import HistoryDisplay, LengthDisplay
from rpil.audit.record import Audit
from rpil.data.files import replacing
from rpil.inference.judgement import FINDINGS

# A page with more timelines than this is slow to open; the least trusted demonstrations are the ones to look at.
MOST_TIMELINES = 200


@dataclass(frozen=True, eq=False)
class Part:
    """One audit on a page.

    Attributes
    ----------
    title : str
    audit : Audit
    source : str
        Where the demonstrations came from: a file name or another name for the data.
    summary : str
        One sentence for the head of a page of several parts, which leads to this one.
    sections : sequence of (heading, body)
        Blocks to show before the ranking; a body that is `Markup` is taken as HTML, any other text is escaped.
    seconds : float, optional
        How long the audit took.
    """

    title: str
    audit: Audit
    source: str
    summary: str = ""
    sections: Sequence[tuple[str, str | Markup]] = ()
    seconds: float | None = None


def render(parts: Sequence[Part], *, title: str = "", headline: str = "", lead: str = "") -> str:
    """Audits as one self-contained HTML page.

    Parameters
    ----------
    parts : sequence of Part
        In the order of the page.
    title, headline, lead : str
        What the page is, if not the title of its first part; of several parts, what they say in a sentence, and a
        paragraph below it.
    """
    environment = Environment(
        loader=PackageLoader("rpil.audit", "html"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "percent": percent, "count": count}
    article = environment.get_template("audit.html")
    shown = []
    for k, part in enumerate(parts, start=1):
        # No two ids on a page are the same.
        level, prefix = (1, "") if len(parts) == 1 else (2, f"part-{k}-")
        html = article.render(summarise(part.audit, prefix), part=part, prefix=prefix, level=level)
        shown.append({"title": part.title, "summary": part.summary, "html": Markup(html)})
    page = environment.get_template("template.html")
    return page.render(title=title or parts[0].title, headline=headline, lead=lead, parts=shown)


def write(path: str | os.PathLike[str], parts: Sequence[Part], **words: str) -> None:
    """Write what `render` returns to `path`, which is replaced only once the new report is complete."""
    page = render(parts, **words)
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8") as stream:
        stream.write(page)


def summarise(audit: Audit, prefix: str = "") -> dict[str, Any]:
    """All that the page shows of an audit, as plain values, texts and pictures; `prefix` starts every id."""
    order = audit.ranking()
    timelines = Timelines(audit)
    # The group of a demonstration, A or B, in the order of `competing`.
    groups = {name: "AB"[g] for g, members in enumerate(audit.competing) for name in members}
    parts = {name: part for name, part in audit.evidence.items() if part.any()}
    if len(parts) == 1:
        parts = {}  # it is the log-odds

    def picture(display: Any, name: str, label: str) -> Markup:
        return inline_svg(display(audit).plot, size=(4.6, 3), label=label, salt=f"{prefix}{name}")

    rows = [
        _row(audit, m, f"{prefix}demonstration-{m}")
        | {
            "rank": rank,
            "group": groups.get(audit.ids[m], ""),
            "parts": [float(part[m]) for part in parts.values()],
            "timeline": timelines.one(m) if rank > len(order) - MOST_TIMELINES else None,
        }
        for rank, m in enumerate(map(int, order), start=1)
    ]
    return {
        "audit": audit,
        "finding_says": FINDINGS[audit.finding],
        "next": NEXT_STEPS[audit.finding],
        "p_expert": P_EXPERT,
        "parts": list(parts),
        "rows": rows,
        "verdicts": {verdict: audit.verdicts.count(verdict) for verdict in ("expert", "uncertain", "adversary")},
        "steps": int(audit.offsets[-1]),
        "weight": float(np.mean(audit.step_weight)),
        "iterations": len(audit.history),
        "groups": [{"letter": "AB"[g], "ids": members} for g, members in enumerate(audit.competing)],
        "scale": timelines,
        "length_picture": picture(
            LengthDisplay,
            "length",
            "Reliability of each demonstration against its number of steps, coloured by verdict.",
        ),
        "history_picture": picture(HistoryDisplay, "history", "The objective of each round."),
    }


def _row(audit: Audit, m: int, anchor: str) -> dict[str, Any]:
    """What the audit says of demonstration `m`."""
    return {
        "anchor": anchor,
        "id": audit.ids[m],
        "verdict": audit.verdicts[m],
        "log_odds": float(audit.log_odds[m]),
        "expert_proba": float(audit.expert_proba[m]),
        "reliability": float(audit.reliability[m]),
        "low": float(audit.reliability_interval[m, 0]),
        "high": float(audit.reliability_interval[m, 1]),
        "steps": int(audit.lengths[m]),
        "worst": audit.worst_steps(m),
    }
