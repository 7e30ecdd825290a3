"""An audit in a few sentences: which to look at first, the finding, doubts, the verdicts, and the question."""

from __future__ import annotations

from collections.abc import Collection, Hashable

import numpy as np

from rpil.data.text import MAX_IDS, counted, listed
from rpil.inference.findings import FINDINGS
from rpil.results.answering import looking_order, n_first
from rpil.results.result import AuditResult
from rpil.results.vocabulary import SIDES, in_numbers, numbered, short_id

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


def verdict_sentence(audit: AuditResult) -> str:
    """How many demonstrations have which verdict."""
    size = f"{counted(len(audit.ids), 'demonstration')} ({audit.offsets[-1]:,} steps)"
    return f"{size}: {in_numbers(audit.verdict_counts())}."
