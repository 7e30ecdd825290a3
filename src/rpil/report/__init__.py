"""One HTML file that tells a reader which demonstrations to trust; it needs no network and no server."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from rpil.audit import Audit
from rpil.plots import HistoryDisplay, LengthDisplay
from rpil.report.pictures import Timelines, inline_svg, returns_figure
from rpil.report.wording import count, number, percent

__all__ = ["render", "returns_figure", "summarise", "write"]

# A page with more timelines than this is slow to open; the least trusted demonstrations are the ones to look at.
MOST_TIMELINES = 200


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
    environment = Environment(
        loader=PackageLoader("rpil", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "percent": percent, "count": count}
    page = environment.get_template("template.html")
    return page.render(summarise(audit), title=title, source=source, seconds=seconds, sections=sections)


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
    from rpil.files import replacing

    page = render(audit, title=title, source=source, seconds=seconds, sections=sections)
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8") as stream:
        stream.write(page)


def summarise(audit: Audit) -> dict[str, Any]:
    """All that the page shows, as plain values, texts and pictures."""
    order = audit.ranking()
    timelines = Timelines(audit)
    # The group of a demonstration: A, B, ... in the order of `competing`.
    groups = {name: _letter(g) for g, members in enumerate(audit.competing) for name in members}
    rows = [
        {
            "rank": rank,
            "anchor": f"demonstration-{m}",
            "id": audit.ids[m],
            "group": groups.get(audit.ids[m], ""),
            "verdict": audit.verdicts[m],
            "log_odds": float(audit.log_odds[m]),
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
        "rows": rows,
        "verdicts": {verdict: audit.verdicts.count(verdict) for verdict in ("expert", "uncertain", "adversary")},
        "steps": int(audit.offsets[-1]),
        "weight": float(np.mean(audit.step_weight)),
        "prior": audit.prior,
        "adversary": audit.adversary,
        "iterations": len(audit.history),
        "identifiable": audit.identifiable,
        "groups": [{"letter": _letter(g), "ids": members} for g, members in enumerate(audit.competing)],
        "to_label": audit.to_label,
        "scale": timelines,
        "length_picture": inline_svg(
            LengthDisplay(audit).plot,
            size=(4.6, 3),
            label="Reliability of each demonstration against its number of steps, coloured by verdict.",
            salt="length",
        ),
        "history_picture": inline_svg(
            HistoryDisplay(audit).plot,
            size=(4.6, 3),
            label="The EM objective at each iteration.",
            salt="history",
        ),
        "assumptions": audit.assumptions,
    }


def _letter(group: int) -> str:
    return chr(ord("A") + group) if group < 26 else str(group + 1)
