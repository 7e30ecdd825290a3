"""An audit in about eight lines of text, or in a notebook: finding, verdicts, doubts, and the lowest scores."""

from __future__ import annotations

from collections.abc import Collection, Hashable
from html import escape

import numpy as np

from rpil.data.text import MAX_IDS, counted, listed
from rpil.inference.findings import FINDINGS
from rpil.results.answering import looking_order, n_first
from rpil.results.result import AuditResult
from rpil.results.vocabulary import SIDES, in_numbers, numbered, short_id

N_LOWEST = 3
"""Demonstrations that the text names."""

N_LOWEST_ROWS = 10
"""Demonstrations that a notebook shows."""

MAX_NAMED_FIRST = 12
"""Demonstrations to look at first that a sentence names."""

ACTING = {"outliers": "differently from the rest", "mixture": "like the adversary that was named"}


def look_first(audit: AuditResult, faulty: Collection[Hashable] = ()) -> list[int]:
    """Demonstrations without a label to look at first: the `faulty` ones, then the first in the order of looking."""
    at, order = {name: m for m, name in enumerate(audit.ids)}, looking_order(audit)[0]
    known = {*np.flatnonzero(audit.answers.shared(audit.copy_of).said).tolist()}
    first = dict.fromkeys(m for m in (*(at[name] for name in faulty if name in at), *order) if m not in known)
    return [*first][: n_first(len(audit.ids))]


def first_sentence(audit: AuditResult, faulty: Collection[Hashable] = ()) -> str:
    """Which demonstrations to look at first, without those that have a label."""
    first = look_first(audit, faulty)
    if not first:
        return "Every demonstration has a label."
    names = listed([short_id(audit.ids[m]) for m in first], MAX_NAMED_FIRST, ", ")
    return f"Look at {'these' if len(first) > 1 else 'this'} {len(first):,} first: {names}."


def headline(audit: AuditResult, most: int = MAX_IDS) -> str:
    """The finding in one sentence, with numbers and up to `most` names, the lowest score first; 0 for none."""
    counts, ranked = audit.verdict_counts(), audit.ranking()[::-1].tolist()
    below = [one for one, size in counts.items() if size and SIDES[one] == "lower"]
    lists = ([short_id(audit.ids[m]) for m in ranked if audit.verdicts[m] == one] for one in below)
    names = {one: listed(own, most, ", ") for one, own in zip(below, lists, strict=True) if most}
    if audit.finding == "answered":
        sizes = ((one, size) for one, size in counts.items() if size and one != "outlier")
        said = (numbered(size, one) + f" ({names.get(one)})" * (one in names) for one, size in sizes)
        return f"By {audit.told}: {', '.join(said)}."
    if audit.finding in ACTING and below:
        n = counts[below[0]]
        some = f"{n:,} of {len(audit.ids):,} act{'s' * (n == 1)} {ACTING[audit.finding]}"
        return f"{some}: {names[below[0]]}." if names else f"{some}."
    sentence = FINDINGS[audit.finding]
    if audit.finding == "a group apart" and audit.groups:
        alike, n = {*audit.groups["B"]}, sum(map(len, audit.groups.values()))  # of one task
        own = [short_id(audit.ids[m]) for m in ranked if audit.ids[m] in alike]
        who = f"{len(own):,} of {n:,} act alike, and differ from the rest"
        members = f" ({listed(own, most, ', ')})" if most else ""
        return f"{who}{members}; {sentence.partition('; ')[2]}"
    if audit.finding == "two groups" and audit.groups:
        both = " and ".join(f"{len(ids):,}" for ids in audit.groups.values())
        return f"Two groups act differently: {both}{sentence.removeprefix('Two groups act differently')}"
    if audit.finding != "nothing could be learned":
        return sentence
    return f"{audit.finding.capitalize()}: {sentence[:1].lower()}{sentence[1:]}"


def overview_text(audit: AuditResult) -> str:
    """Text of ``repr`` of an audit."""
    size = f"{counted(len(audit.ids), 'demonstration')}, {int(audit.offsets[-1]):,} steps"
    lines = [f"Audit: {first_sentence(audit)}", headline(audit), f"{size}: {in_numbers(audit.verdict_counts())}."]
    if audit.doubts:
        more = len(audit.doubts) - 1
        lines.append(f"Doubt: {audit.doubts[0]}" + f" ({more} more in doubts)" * (more > 0))
    if audit.question:
        lines.append(f"Question: {audit.question}")
    lowest = audit.ranking()[::-1][:N_LOWEST].tolist()
    names = [short_id(audit.ids[m]) for m in lowest]
    width = max(map(len, names))
    lines.append(f"The lowest {len(lowest)} scores (log_odds), of {len(audit.ids):,}:")
    for m, name in zip(lowest, names, strict=True):
        lines.append(f"  {name:<{width}}  {audit.verdicts[m]}, {audit.place(m)}, score {audit.log_odds[m]:+.1f}")
    return "\n".join([*lines, "All: to_frame(), plot.ranking(), to_html(path)."])


def overview_html(audit: AuditResult) -> str:
    """HTML that a notebook shows of an audit: the text, and a table of the lowest with their reasons."""
    lowest = audit.ranking()[::-1][:N_LOWEST_ROWS].tolist()
    rows = ([short_id(audit.ids[m]), audit.verdicts[m], audit.place(m), audit.reasons[m]] for m in lowest)
    cells = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows)
    return f"<pre>{escape(overview_text(audit))}</pre><table>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>"
