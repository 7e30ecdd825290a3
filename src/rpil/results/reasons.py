"""The reason for a verdict, as one sentence: what decided, and the steps that differ most.

Steps differ where they are much more likely under the reference, or the named adversary, than under the policy of the
trusted: the stretch of consecutive steps with the lowest sum of log-ratios.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import logit

from rpil.data.text import printable
from rpil.inference.answers import Answers
from rpil.numerics.types import Array, Float
from rpil.results.judged import Judged
from rpil.results.vocabulary import SIDES, WORSE

MIN_STRETCH = 5.0
"""Nats against the policy of the trusted from which a stretch is named: 150 to one. No verdict depends on it."""

NEARLY_ALL = 0.8
"""Share of the steps of a demonstration from which a stretch is nearly all of it."""

THROUGHOUT = "nearly throughout"

AT_STEP = re.compile(r"at step (\d+): ")
"""How a deviation begins that is seen in one step."""

FIFTHS = "Lowest fifth", "Below the middle", "In the middle", "Above the middle", "Highest fifth"

GivenLabel = Literal["good", "bad", ""]
"""The label of a demonstration, or nothing."""


class Stretch(NamedTuple):
    """Consecutive steps of a demonstration, counted from its first step, and the sum of their log-ratios in nats."""

    first: int
    last: int
    nats: float


def worst_stretch(log_ratio: Float[Array, " n"]) -> Stretch | None:
    """The stretch with the lowest sum of log-ratios; None where that is above -`MIN_STRETCH`."""
    # Of all pairs of sums of the first steps, the one that falls most (Kadane's algorithm).
    total = np.concatenate([[0.0], np.cumsum(log_ratio)])
    fall = total - np.maximum.accumulate(total)
    stop = int(np.argmin(fall))
    if fall[stop] > -MIN_STRETCH:
        return None
    return Stretch(int(np.argmax(total[: stop + 1])), stop - 1, float(fall[stop]))


def reasons_of(audit: Judged, answers: Answers, said: Sequence[str]) -> Iterator[str]:
    """The reason for the verdict on each demonstration; the `answers` about one are about its copies too. What was
    `said` of each is `AuditResult.said`."""
    groups = {name: letter for letter, group in zip("AB", audit.competing, strict=False) for name in group}
    rank = np.argsort(np.argsort(audit.log_odds, kind="stable"))
    for m, name in enumerate(audit.ids):
        reason = _by_answers(audit, m, answers, said[m]) or _by_finding(
            audit, groups.get(name, ""), rank[m] / len(rank)
        )
        reason = reason or _by_evidence(audit, m, int(rank[m]))
        place, at, does = _worst_of(audit, m)
        differs = f"{place}{f', most {at}' * bool(at)}{f': {does}' * bool(does)}"
        if reason == DIFFERENT and place:
            reason = f"Different {differs}"
        elif place:
            reason += f"; {'most ' * (place != THROUGHOUT)}different {differs}"
        yield f"{reason}."


DIFFERENT = "Its actions differ from those of most others"
"""The reason for an outlier, unless a stretch of it says more."""


def span(first: int, last: int, fps: float | None) -> str:
    """Consecutive steps in words, in seconds where the steps a second, `fps`, are known."""
    if fps:
        low, high = f"{first / fps:.1f}", f"{(last + 1) / fps:.1f}"
        return f"at {low} s" if low == high or first == last else f"from {low} to {high} s"
    return f"at step {first}" if first == last else f"at steps {first} to {last}"


def _worst_of(audit: Judged, m: int) -> tuple[str, str, str]:
    """Where demonstration `m` differs most, in which step a deviation is seen there, and what it does; or nothing."""
    stretch, does = worst_stretch(audit.log_ratio(m)), audit.deviations[m] if audit.deviations else ""
    if stretch is None or audit.finding == "nothing could be learned":
        return "", "", ""
    is_long = stretch.last + 1 - stretch.first >= NEARLY_ALL * audit.lengths[m]
    place = THROUGHOUT if is_long else span(stretch.first, stretch.last, audit.fps)
    if (seen := AT_STEP.match(does)) is None:
        return place, "", does
    step = int(seen[1])
    return place, span(step, step, audit.fps), does[seen.end() :]


def at_a_glance(audit: Judged, reason: str, m: int) -> tuple[str, str]:
    """Where demonstration `m` differs most, and what it does there, or else the `reason` for its verdict, in short."""
    place, at, does = _worst_of(audit, m)
    why = "" if reason.startswith("Different") else reason.partition(";")[0].rstrip(".")
    has_failed = audit.rejected_by[m : m + 1] == ("outcome",)
    return (at or place).removeprefix("from ").removeprefix("at "), why if has_failed else does or why


def _by_answers(audit: Judged, m: int, answers: Answers, said: str) -> str:
    """The reason by what was said of demonstration `m`, or by what is learned from answers; or nothing."""
    verdict, vocabulary = audit.verdicts[m], audit.vocabulary
    if answers.labels[m]:
        again = ", which contradicts the other answers: look again" * (audit.ids[m] in audit.contradicting)
        return f"Labelled {'good' if answers.labels[m] > 0 else 'bad'}{again}"
    if said and verdict != vocabulary.upper:
        return f"You called it {printable(said)}" if said.startswith(WORSE) else said.replace(" = ", " ")
    if audit.finding != "answered" or verdict == "open":
        return ""
    if verdict not in (vocabulary.upper, vocabulary.lower):
        return ""
    if answers.heard == (1,) and answers.has_outcome[m]:
        values, upper = answers.outcomes[:, 0], verdict == vocabulary.upper
        if values[m] > np.nanmedian(values) if upper else values[m] < np.nanmedian(values):
            return f"Its outcome is among the {'highest' if upper else 'lowest'}"
    return f"{verdict.capitalize()} by {audit.told} about others like it"


def _by_finding(audit: Judged, group: str, above: float) -> str:
    """The reason where the finding gives no demonstration a verdict, or nothing; `group` is A, B or nothing, and
    `above` the share of the demonstrations that it ranks above."""
    if audit.finding in ("a group apart", "two groups"):
        return f"Acts as group {group} does; only an answer can tell which is good" if group else "In neither group"
    if audit.finding == "no outliers":
        return f"{FIFTHS[int(5 * above)]} of the ranking, not clearly different"
    return "Nothing could be learned" if audit.finding == "nothing could be learned" else ""


def _by_evidence(audit: Judged, m: int, rank: int) -> str:
    """What decided about demonstration `m`, which scores higher than `rank` others, or why it has no verdict."""
    vocabulary, log_odds, side = audit.vocabulary, float(audit.log_odds[m]), SIDES[audit.verdicts[m]]
    if side == "open" and audit.anchor == "none":
        return f"{FIFTHS[5 * rank // len(audit.ids)]} of the ranking"
    if side == "open" and abs(log_odds) < logit(audit.settings.min_proba(audit.anchor)):
        return f"Its score is between those of {vocabulary.upper} and {vocabulary.lower} ones"
    if side == "open":
        looks = vocabulary.upper if log_odds > 0 else vocabulary.lower
        return f"Looks {looks} (place {len(audit.ids) - rank:,} of {len(audit.ids):,}); left open to be safe"
    sign = 1 if side == "upper" else -1
    if sign * audit.from_demonstrator[m] > sign * audit.from_actions[m]:
        return "Judged by the other demonstrations of its operator"
    if audit.anchor == "named adversary":
        return f"Acts like the {audit.verdicts[m]}"
    return DIFFERENT
