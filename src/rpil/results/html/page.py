"""The report: the view of an audit as one HTML file that needs no network and no server."""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections import defaultdict
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from rpil.data.files import replacing
from rpil.data.memory import finite
from rpil.data.text import MAX_IDS, counted, printable
from rpil.faults.report import RULES, FaultReport
from rpil.faults.set_table import SetTable
from rpil.inference.findings import DECIDED
from rpil.numerics.types import Array
from rpil.results.answering import looking_order
from rpil.results.choice import choose
from rpil.results.judged import MAX_DRAWN, bin_means, bin_starts
from rpil.results.reasons import TWO_GROUPS, worst_steps, worst_stretch
from rpil.results.result import AuditResult, headline
from rpil.results.vocabulary import SIDES, numbered
from rpil.segments.ranges import KINDS, Segments

MAX_FOUND, MAX_FIRST = 20_000, 8
"""Recording faults of a view, the worst, and the demonstrations with one that are shown first."""

LEVELS = 254
"""Between the lowest and the highest value of a curve; a byte has one more, which stands for no value."""

NO_VALUE = 255

View = dict[str, object]


def no_faults() -> FaultReport:
    """The faults of an audit whose recording was not looked through for any."""
    return FaultReport((), {}, {}, {}, {}, 0, 0)


@dataclass(frozen=True, eq=False)
class About:
    """Context that the page of an audit shows beside the audit."""

    title: str
    source: str
    """The name of the data."""
    read: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    faults: FaultReport = field(default_factory=no_faults)
    table: SetTable | None = None
    """The set in one table, which stands first."""
    tasks: Mapping[str, str] = field(default_factory=dict)
    """By ids as text, as `demonstrators`."""
    demonstrators: Mapping[str, str] = field(default_factory=dict)
    segments: Segments | None = None
    lerobot: bool = False


def make_view(audit: AuditResult, about: About, drawn: int = MAX_DRAWN) -> View:
    """The view of an audit: all that the script of its page draws, as one dict of numbers, text, lists and dicts, with
    drawings of the `drawn` first in the order of looking.

    Demonstrations are numbered by their place in the data, from 0 on, and M are all of them; ids are such numbers. Keys
    with the name of a field of `About` or `Audit` are this field. Of the others:

    answers, rows
        [demonstration, "good", "bad", "better than ID" or "same as ID"]; [demonstration, first, the one after the last,
        "good" or "bad"].
    demonstrations
        Columns of M, by the names of `AuditResult.table` and: p (None where the place is shown in its stead), evidence
        (dict of columns), worst (lists of steps), stretch (the first and the last of the worst steps in a row, or
        None), group ("A", "B" or ""), session, order, facts (dict of columns), kept.
    faults
        Columns of the worst ones, of each rule words and n, and numbers of those shown first.
    segments, drawings
        By number as text. In P points, of which point k begins at step ``k * n_steps // P``: ratio (min, mean, max of
        the log-ratios), and trust (mean of the trust in the steps). Curves are packed by `packed`.
    """
    order, n_review = looking_order(audit)
    places, counts = {name: m for m, name in enumerate(audit.ids)}, audit.verdict_counts()
    compared = {"better than": audit.answers.pairs, "same as": audit.answers.tied}
    answers = [[m, "good" if sign > 0 else "bad"] for m, sign in enumerate(audit.answers.labels.tolist()) if sign]
    answers += ([a, f"{word} {audit.ids[b]}"] for word, pairs in compared.items() for a, b in pairs.tolist())
    segments = defaultdict[str, list[list[object]]](list)  # of those that are drawn, and others with a reason
    if (found := about.segments) is not None:
        columns, shown = (found.demonstration, found.start, found.end, found.kind), {*order[:MAX_DRAWN]}
        for m, start, end, kind, why in zip(*(one.tolist() for one in columns), found.reason, strict=True):
            if why or m in shown:
                segments[str(m)].append([start, end, KINDS[kind], why])
    return {
        "run": audit.run_id,
        "probability": audit.vocabulary.probability,
        "sides": {verdict: SIDES[verdict] for verdict in counts},
        "counts": counts,
        "question": audit.question or "",
        "pair": [places[name] for name in audit.pair] if audit.question else [],
        "contradicting": [places[name] for name in audit.contradicting],
        "answers": answers,
        "demonstrations": _columns(audit, about),
        "whole_ids": all(isinstance(name, int) for name in audit.ids),
        "n_review": n_review,
        "faults": _faults(places, about.faults),
        "segments": segments,
        "rows": [
            [m, first, last, "good" if sign > 0 else "bad"] for m, first, last, sign in audit.answers.marks.tolist()
        ],
        "fps": audit.fps,
        "lerobot": about.lerobot,
        "provenance": audit.provenance or {},
        "drawings": drawings(audit, order[:drawn]),
    }


def _columns(audit: AuditResult, about: About) -> View:
    """The columns of the demonstrations."""
    letters = {name: letter for letter, members in audit.groups.items() for name in members}
    names, facts, table = list(map(str, audit.ids)), dict(audit.facts), audit.table(about.demonstrators, about.tasks)
    kept, parts = {*choose(table).kept}, {name: part.tolist() for name, part in audit.evidence.items() if part.any()}
    shown = {audit.vocabulary.upper, audit.vocabulary.lower, "open"}
    shown -= set() if audit.anchor == "named adversary" else {"open"}
    as_in_table = "verdict", "rank", "n_steps", "reason", "task", "demonstrator", "log_odds", "reliability"
    return {
        "id": names,
        **{name: list(table[name]) for name in as_in_table},
        "p": [p if audit.verdicts[m] in shown else None for m, p in enumerate(audit.expert_proba.tolist())],
        "evidence": parts if len(parts) > 1 else {},
        "worst": [worst_steps(audit.step_log_ratio[audit.steps(m)]) for m in range(len(names))],
        "stretch": [worst_stretch(audit.log_ratio(m)) for m in range(len(names))],
        "look": (np.array(table["look"]) - 1).tolist(),
        "group": [letters.get(name, "") for name in audit.ids],
        "session": list(map(str, facts.pop("session", [""] * len(names)))),
        "order": list(facts.pop("order", ())),
        "facts": facts,
        "kept": [name in kept for name in audit.ids],
    }


def _faults(places: Mapping[Hashable, int], report: FaultReport) -> View:
    """The recording faults of the demonstrations at these `places`."""
    found = report.findings[:MAX_FOUND]
    numbers = {str(name): m for name, m in places.items()}
    at = [numbers.get(str(one.id)) for one in found]
    odd = {places[name] for name in report.odd if name in places}
    named = ((one, one.id == "" or m is not None) for one, m in zip(found, at, strict=True))
    return {
        "first": [at.index(m) for m in dict.fromkeys(at) if m in odd][:MAX_FIRST],
        "kinds": [
            {"rule": rule, "words": RULES[rule].words, "n": count}
            for rule, count in sorted(report.counts.items(), key=lambda item: -item[1])
        ],
        "found": {
            "rule": [one.rule for one in found],
            "demonstration": at,
            "sentence": [one.sentence if is_known else f"{one.id}: {one.sentence}" for one, is_known in named],
        },
    }


def drawings(audit: AuditResult, members: Sequence[int]) -> dict[str, dict[str, object]]:
    """The drawings of some demonstrations by their numbers, see above; trust is `Audit.step_trust`."""
    drawn: dict[str, dict[str, object]] = {}
    for m in members:
        ratio, trust = audit.log_ratio(m), {"mean": bin_means(audit.step_trust(m))}
        starts = bin_starts(len(ratio))
        extremes = {"min": np.minimum.reduceat(ratio, starts), "max": np.maximum.reduceat(ratio, starts)}
        drawn[str(m)] = {"ratio": packed({**extremes, "mean": bin_means(ratio)}), "trust": packed(trust, (0.0, 1.0))}
    return drawn


def packed(curves: dict[str, Array], limits: tuple[float, float] | None = None) -> dict[str, object]:
    """Curves on one scale: each as base64 of bytes, where 0 is "from" and 254 is "to"; 255 is no value."""
    values = np.array([*curves.values()], dtype=float)
    known = values[np.isfinite(values)]
    low, high = limits or ((float(known.min()), float(known.max())) if known.size else (0.0, 0.0))
    scaled = LEVELS * (values - low) / (high - low or 1.0)
    codes = np.where(np.isfinite(values), np.clip(np.nan_to_num(scaled), 0, LEVELS).round(), NO_VALUE)
    texts = [base64.b64encode(one.tobytes()).decode() for one in codes.astype(np.uint8)]
    return {"from": float(f"{low:.6g}"), "to": float(f"{high:.6g}"), **dict(zip(curves, texts, strict=True))}


Sections = Sequence[tuple[str, str | Markup]]
Live = tuple[View, Markup, Markup]
"""The HTML of a page that asks its server: the view, what stands below the heading, and the script."""

_UNSAFE_IN_SCRIPT = {ord(character): f"\\u{ord(character):04x}" for character in "<>&"}


@cache
def html_environment(package: str, folder: str) -> Environment:
    """The environment of the Jinja templates in a folder of a package; what they insert is escaped and `printable`."""
    loader = PackageLoader(package, folder)
    jinja = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        finalize=lambda value: value if isinstance(value, Markup) else printable(value, kept="\n\t"),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    jinja.filters |= {"count": counted, "numbered": numbered, "plain": _plain, "hash": _csp_hash, "data": _as_data}
    jinja.filters["percent"] = lambda share: f"{100 * share:.0f} %"
    # Scripts and styles are no templates: braces mean something else there.
    jinja.globals["asset"] = lambda name: Markup(loader.get_source(jinja, name)[0])
    return jinja


def _csp_hash(code: str) -> Markup:
    """The hash by which a Content-Security-Policy allows the code of an element, and no other code."""
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    return Markup("'sha256-{}'").format(digest)


def _as_data(value: object) -> Markup:
    """JSON for a script element that holds data: in ASCII, and without the characters that could end the element."""
    text = json.dumps(finite(value), allow_nan=False, separators=(",", ":"))
    return Markup(text.translate(_UNSAFE_IN_SCRIPT))  # it has no character that HTML knows


def _plain(value: object) -> str:
    """A value of the provenance as text."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_plain(one)}" for name, one in value.items())
    return "; ".join(map(_plain, value)) if isinstance(value, list | tuple) else str(value)


def render_page(audit: AuditResult, about: About, sections: Sections = (), live: Live | None = None) -> str:
    """An audit as one self-contained HTML page.

    Below its table stand `sections` of a heading and a body, which is `Markup` or is escaped. A page that is `live`
    asks its server, and names nobody beside the question; any other asks nobody.
    """
    template = html_environment("rpil.results", "html").get_template("page.html")
    view, top, script = live or (make_view(audit, about), Markup(""), Markup(""))
    sentence = headline(audit, 0 if live else MAX_IDS)
    decided = audit.finding in DECIDED or {*audit.verdicts} != {"open"}
    given = {"audit": audit, "about": about, "view": view, "sections": sections, "top": top, "live": script}
    differ = [note for note in audit.notes if TWO_GROUPS in note]
    return template.render(**given, sentence=sentence, decided=decided, differ=differ)


def write_page(path: str | os.PathLike[str], audit: AuditResult, about: About, sections: Sections = ()) -> None:
    """Write the page of `render_page` to `path`, which is replaced only once the new page is complete."""
    page = render_page(audit, about, sections)
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", errors="backslashreplace") as stream:
        stream.write(page)
