"""The view: all that the page of an audit draws, as one dict of numbers, text, lists and dicts.

The report holds it, and a review shows it. Demonstrations are numbered by their place in the data, from 0 on; M are all
of them. Keys with the name of a field of `About` or `Audit` are this field; ids are numbers of demonstrations there.
The others are:

run, finding, vocabulary
    The run id; name, sentence, next (what to do) and decided (whether there are verdicts); words and threshold of P.
sides, counts, share
    The side of each verdict in use, its number of demonstrations, and the share of the upper one (mean, low, high).
question, pair
    The question, or ""; the two demonstrations that it is about, or none.
answers
    The labels and pairs that were given: [demonstration, "good", "bad", "better than ID" or "same as ID"].
demonstrations
    Columns of M, by the names of `AuditResult.table` and: p (None where the place is shown in its stead), evidence
    (dict of columns), low and high (of the reliability), worst (lists of steps), stretch (the first and the last of the
    worst steps in a row, or None), group ("A", "B" or ""), session, order, facts (dict of columns), kept.
whole_ids, n_review, differ
    Whether the ids are whole numbers; how many to look at first; how the groups A and B differ.
demonstrators
    For each name, mean, low, high (trust; None without answers), n (demonstrations), counts (of verdicts) and style.
faults
    Recording faults: kinds (of each rule, words and n), found (columns rule, demonstration or None, sentence;
    the worst first), n_odd (demonstrations), first (the worst of some of them, numbers of found), beside (sentences on
    files and videos), not_checked (of each reason, rules), usual (sentences).
drawings
    For the first in the order of looking, by number as text. In P points, of which point k begins at
    step ``k * n_steps // P``: ratio (min, mean, max of the log-ratios), trust (mean of the trust in the steps), parts
    with most of the evidence (name, share of the evidence, nats, value, low and high of what the rest do there), and of
    discrete actions taken (names, codes). Curves are packed by `packed`.
"""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np

from rpil.data.text import MAX_IDS
from rpil.faults.report import RULES, FaultReport
from rpil.inference.findings import DECIDED
from rpil.numerics.types import Array, Int
from rpil.results import answering
from rpil.results.choice import choose
from rpil.results.facts import TWO_GROUPS
from rpil.results.judged import MAX_DRAWN, bin_means, bin_starts
from rpil.results.overview import headline
from rpil.results.result import MAX_LOG_ODDS, AuditResult
from rpil.results.vocabulary import SIDES

MAX_FOUND, MAX_FIRST = 20_000, 8
"""Recording faults of a view, the worst, and the demonstrations with one that are shown first."""

DECIMALS_SHOWN = 9
"""Of probabilities and shares."""

LEVELS = 254
"""Between the lowest and the highest value of a curve; a byte has one more, which stands for no value."""

NO_VALUE = 255

View = dict[str, object]


@dataclass(frozen=True, eq=False)
class About:
    """What the page of an audit shows beside the audit."""

    title: str
    source: str
    """The name of the data."""
    read: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    faults: FaultReport | None = None
    tasks: Mapping[str, str] = field(default_factory=dict)
    """By ids as text, as `demonstrators`."""
    demonstrators: Mapping[str, str] = field(default_factory=dict)
    lerobot: bool = False
    hub: str = ""


def make_view(audit: AuditResult, about: About, drawn: int = MAX_DRAWN, named: int = MAX_IDS) -> View:
    """The view of an audit, with drawings of the `drawn` first in the order of looking, `named` ids in its finding."""
    order, n_review = answering.looking_order(audit)
    asked = answering.is_asked(audit)
    places = {name: m for m, name in enumerate(audit.ids)}
    return {
        "run": audit.run_id,
        "title": about.title,
        "source": about.source,
        **_finding(audit, named),
        "question": answering.question(audit) or "",
        "pair": [places[name] for name in audit.pair] if asked else [],
        "doubts": list(audit.doubts),
        "notes": [note for note in audit.notes if TWO_GROUPS not in note],
        "differ": [note for note in audit.notes if TWO_GROUPS in note],
        "assumptions": list(audit.assumptions),
        "lost": list(about.lost),
        "read": list(about.read),
        "contradicting": [places[name] for name in audit.contradicting],
        "answers": _answers(audit),
        "demonstrations": _columns(audit, about, order),
        "whole_ids": all(isinstance(name, int) for name in audit.ids),
        "n_review": n_review,
        "demonstrators": [
            {"name": str(one.name), **(asdict(one.trust) if one.trust else dict.fromkeys(("mean", "low", "high")))}
            | {"n": len(one.demonstrations), "counts": audit.verdict_counts(one.demonstrations)}
            | {"style": audit.style(one)}
            for one in audit.demonstrators
        ],
        "faults": _faults(audit, about.faults),
        "fps": audit.fps,
        "lerobot": about.lerobot,
        "hub": about.hub,
        "provenance": {} if audit.provenance is None else audit.provenance.to_dict(),
        "drawings": drawings(audit, order[:drawn]),
    }


def _finding(audit: AuditResult, named: int) -> View:
    """What the audit says as a whole."""
    vocabulary, finding = audit.vocabulary, audit.finding
    counts = audit.verdict_counts()
    return {
        "finding": {
            "name": finding,
            "sentence": headline(audit, named),
            "next": answering.NEXT_STEPS[finding],
            "decided": finding in DECIDED or {*audit.verdicts} != {"open"},
        },
        "vocabulary": {
            **{name: getattr(vocabulary, name) for name in ("upper", "lower", "probability")},
            "meaning": vocabulary.explanation,
            "threshold": audit.settings.min_proba(audit.anchor),
        },
        "sides": {verdict: SIDES[verdict] for verdict in counts},
        "counts": counts,
        "share": asdict(audit.prior),
        "adversary": audit.adversary,
    }


def _answers(audit: AuditResult) -> list[list[object]]:
    """The labels and pairs that were given, as a file of labels has them."""
    labels = audit.answers.labels
    given = [[m, "good" if labels[m] > 0 else "bad"] for m in np.flatnonzero(labels).tolist()]
    compared = {"better than": audit.answers.pairs, "same as": audit.answers.tied}
    return given + [[a, f"{word} {audit.ids[b]}"] for word, pairs in compared.items() for a, b in pairs.tolist()]


def _columns(audit: AuditResult, about: About, order: Sequence[int]) -> View:
    """The columns of the demonstrations."""
    letters = {name: letter for letter, members in audit.groups.items() for name in members}
    names, facts, table = list(map(str, audit.ids)), audit.facts, audit.table(about.demonstrators, about.tasks)
    kept = {*choose(table).kept}
    return {
        "id": names,
        **{name: list(table[name]) for name in ("verdict", "rank", "n_steps", "reason", "task", "demonstrator")},
        "log_odds": _significant(audit.log_odds),
        "p": [
            round(p, DECIMALS_SHOWN) if audit.has_proba(m) else None for m, p in enumerate(audit.expert_proba.tolist())
        ],
        "evidence": {name: _significant(part) for name, part in audit.evidence_columns().items()},
        "reliability": audit.reliability.round(DECIMALS_SHOWN).tolist(),
        "worst": [audit.worst_steps(m) for m in range(len(names))],
        "stretch": [answering.stretch_of(audit, m) for m in range(len(names))],
        "look": np.argsort(order).tolist(),
        "group": [letters.get(name, "") for name in audit.ids],
        "session": list(map(str, facts.get("session", [""] * len(names)))),
        "order": list(facts.get("order", ())),
        "facts": {
            name: [value if isinstance(value, str) else round(float(value), 3) for value in values]
            for name, values in facts.items()
            if name not in ("session", "order")
        },
        "kept": [name in kept for name in audit.ids],
    }


def _significant(values: Array) -> list[float]:
    """Numbers with few digits; infinite ones as large as an audit's may be, because JSON has no infinity."""
    bounded = np.nan_to_num(values, posinf=MAX_LOG_ODDS, neginf=-MAX_LOG_ODDS).tolist()
    return [significant(value) for value in bounded]


def _faults(audit: AuditResult, report: FaultReport | None) -> View:
    """The recording faults."""
    if report is None:
        return {"kinds": [], "found": {}, "n_odd": 0, "first": [], "beside": [], "not_checked": [], "usual": []}
    places = {str(name): m for m, name in enumerate(audit.ids)}
    found = report.findings[:MAX_FOUND]
    worst: dict[int | None, int] = {}
    for k, one in enumerate(found):
        worst.setdefault(places.get(str(one.id)), k)
    return {
        "n_odd": len(report.odd),
        "first": [k for m, k in worst.items() if m is not None and audit.ids[m] in report.odd][:MAX_FIRST],
        "beside": [one.sentence for one in report.lines if one.id == ""][:MAX_FIRST],
        "kinds": [
            {"rule": rule, "words": RULES[rule].words, "n": count}
            for rule, count in sorted(report.counts.items(), key=lambda item: -item[1])
        ],
        "found": {
            "rule": [one.rule for one in found],
            "demonstration": [places.get(str(one.id)) for one in found],
            "sentence": [
                one.sentence if one.id == "" or str(one.id) in places else f"{one.id}: {one.sentence}" for one in found
            ],
        },
        "not_checked": [{"reason": reason, "rules": rules} for reason, rules in report.reasons.items()],
        "usual": list(report.usual.values()),
    }


def drawings(audit: AuditResult, members: Sequence[int]) -> dict[str, dict[str, object]]:
    """The drawings of some demonstrations by their numbers, see above; trust is `Audit.step_trust`."""
    return {str(m): _drawn(audit, m) for m in members}


def _drawn(audit: AuditResult, m: int) -> dict[str, object]:
    ratio, trust = audit.log_ratio(m), audit.step_trust(m)
    starts = bin_starts(len(ratio))
    extremes = {"min": np.minimum.reduceat(ratio, starts), "max": np.maximum.reduceat(ratio, starts)}
    traces = audit.traces.get(audit.ids[m])
    taken = traces.taken if traces else ()
    names = sorted(name for name, _ in Counter(taken).most_common(NO_VALUE))  # a byte tells no more apart
    codes = dict(zip(names, range(len(names)), strict=True))
    return {
        "ratio": packed({**extremes, "mean": bin_means(ratio)}),
        "trust": packed({"mean": bin_means(trust)}, (0.0, 1.0)),
        "taken": {"names": names, "codes": _as_text(np.array([codes.get(one, NO_VALUE) for one in taken]))},
        "parts": [
            {"name": part.name, "share": round(part.share, 4), "nats": significant(part.nats)}
            | packed({"value": part.value, "low": part.low, "high": part.high})
            for part in (traces.parts if traces else ())
        ],
    }


def packed(curves: dict[str, Array], limits: tuple[float, float] | None = None) -> dict[str, object]:
    """Curves on one scale: each as base64 of bytes, where 0 is "from" and 254 is "to"; 255 is no value."""
    values = np.array([*curves.values()], dtype=float)
    known = values[np.isfinite(values)]
    low, high = limits or ((float(known.min()), float(known.max())) if known.size else (0.0, 0.0))
    scaled = LEVELS * (values - low) / (high - low or 1.0)
    codes = np.where(np.isfinite(values), np.clip(np.nan_to_num(scaled), 0, LEVELS).round(), NO_VALUE)
    return {"from": significant(low), "to": significant(high), **dict(zip(curves, map(_as_text, codes), strict=True))}


def _as_text(codes: Int[Array, " P"]) -> str:
    """Base64 of bytes."""
    return base64.b64encode(codes.astype(np.uint8).tobytes()).decode()


def significant(value: float) -> float:
    """A number with six significant digits."""
    return float(f"{value:.6g}")
