"""Facts about demonstrations, and the reason for each verdict.

Facts change no verdict, and say nothing about quality. Most are ranks within the demonstrations that were judged
together, from 0 to 1: 1 is the longest, the smoothest, and so on. They are the ranks of the channels from which answers
learn (`rpil.inference.channels`).

A reason is one sentence: what decided, and the steps that differ most. Steps differ where they are much more likely
under the reference, or the named adversary, than under the policy of the trusted: the stretch of consecutive steps with
the lowest sum of log-ratios.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.special import logit, ndtr

from rpil.data.text import listed, printable
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS
from rpil.numerics.regression import mean_ranks
from rpil.numerics.types import Array, Float, Int
from rpil.results.judged import ALONE, Judged
from rpil.results.vocabulary import WORSE

MIN_STRETCH = 5.0
"""Nats against the policy of the trusted from which a stretch is named: 150 to one. No verdict depends on it."""

NEARLY_ALL = 0.8
"""Share of the steps of a demonstration from which a stretch is nearly all of it."""

THROUGHOUT = "nearly throughout"

AT_STEP = re.compile(r"at step (\d+): ")
"""How a deviation begins that is seen in one step."""

FIFTHS = "Lowest fifth", "Below the middle", "In the middle", "Above the middle", "Highest fifth"


def worst_stretch(log_ratio: Float[Array, " n"]) -> tuple[int, int] | None:
    """The first and the last of the consecutive steps with the lowest sum of log-ratios; None where that is above
    -`MIN_STRETCH`."""
    # Of all pairs of sums of the first steps, the one that falls most (Kadane's algorithm).
    total = np.concatenate([[0.0], np.cumsum(log_ratio)])
    fall = total - np.maximum.accumulate(total)
    stop = int(np.argmin(fall))
    if fall[stop] > -MIN_STRETCH:
        return None
    return int(np.argmax(total[: stop + 1])), stop - 1


def worst_steps(log_ratio: Float[Array, " n"], k: int = 5) -> list[int]:
    """Up to `k` steps with the lowest log-ratios below 0, the lowest first."""
    return [int(n) for n in np.argsort(log_ratio, kind="stable")[:k] if log_ratio[n] < 0]


def reasons_of(audit: Judged, answers: Answers, said: Sequence[str]) -> Iterator[str]:
    """The reason for the verdict on each demonstration; the `answers` about one are about its copies too. What was
    `said` of each is `AuditResult.said`."""
    groups = {name: letter for letter, group in zip("AB", audit.competing, strict=False) for name in group}
    rank = np.argsort(np.argsort(audit.log_odds, kind="stable"))
    zero = (answers.outcomes[:, max(k := answers.only_flag, 0) : k + 1] == 0).any(axis=1)  # in the only flag
    spared = zero & (answers.labels == 0) & ~answers.failed(audit.log_odds) & (audit.log_odds > 0)
    for m, name in enumerate(audit.ids):
        reason = _by_answers(audit, m, answers, said[m]) or _by_scores(audit, m, int(rank[m]), groups.get(name, ""))
        reason += f", though {answers.failure}" if spared[m] and not said[m] else ""
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
    first, last = stretch
    place = THROUGHOUT if last + 1 - first >= NEARLY_ALL * audit.lengths[m] else span(first, last, audit.fps)
    if (seen := AT_STEP.match(does)) is None:
        return place, "", does
    at = span(int(seen[1]), int(seen[1]), audit.fps)
    return place, at * (at != place), does[seen.end() :]


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
    is_learned = audit.finding == "answered" and verdict in ("good", "bad")
    return f"{verdict.capitalize()} by {audit.told} about others like it" if is_learned else ""


def _by_scores(audit: Judged, m: int, rank: int, group: str) -> str:
    """The reason where no answer decided about demonstration `m`, of `group` A, B or nothing, which scores higher than
    `rank` others."""
    vocabulary, log_odds = audit.vocabulary, float(audit.log_odds[m])
    verdict, finding = audit.verdicts[m], audit.finding
    if audit.task_of is not None and audit.task_of[m] < 0:
        return ALONE.rstrip(".")
    if finding in ("a group apart", "two groups"):
        return f"Acts as group {group} does; only an answer can tell which is good" if group else "In neither group"
    if finding == "nothing could be learned":
        return "Nothing could be learned"
    if finding == "no outliers" or (verdict == "open" and audit.anchor == "none"):
        fifth = FIFTHS[5 * rank // len(audit.ids)]
        return f"{fifth} of the ranking{', not clearly different' * (finding == 'no outliers')}"
    if verdict == "open" and abs(log_odds) < logit(audit.settings.min_proba(audit.anchor)):
        return f"Its score is between those of {vocabulary.upper} and {vocabulary.lower} ones"
    if verdict == "open":
        looks = vocabulary.upper if log_odds > 0 else vocabulary.lower
        return f"Looks {looks} (place {len(audit.ids) - rank:,} of {len(audit.ids):,}); left open to be safe"
    return f"Acts like the {verdict}" if audit.anchor == "named adversary" else DIFFERENT


RANKS: Mapping[str, tuple[str, int, str, str]] = {
    "length": ("length", 1, "is shorter", "takes longer"),
    "smoothness": ("smoothness", 1, "is less smooth", "is smoother"),
    "path": ("short path", -1, "has a shorter path", "has a longer path"),
}
"""Each fact that is a rank: the channel that it is read from, whether it grows or falls with it, and the words
for where it is low and high."""

TWO_GROUPS = "The two groups: "
"""How the sentences begin."""

MAX_P = 0.01
"""Probability of so different facts by chance (Mann and Whitney 1947), up to which a difference is named."""
MIN_SEPARATION = 0.8
"""Share of the pairs of a demonstration of each group that differ in this direction, from which it is named."""

Fact = float | int | str


def known_facts(columns: Float[Array, "M D"], order: Float[Array, " M"] | None) -> dict[str, tuple[Fact, ...]]:
    """The facts about M demonstrations by name; those that are not known are left out.

    The names are those of `RANKS`, and "order", the place among the demonstrations, from 1 on. `columns` are those of
    an audit, which begin with the normal scores of the channels.
    """
    found: dict[str, tuple[Fact, ...]] = {}
    if columns.size:
        for name, (channel, sign, *_) in RANKS.items():
            found[name] = tuple(np.round(ndtr(sign * columns[:, CHANNELS.index(channel)]), 6).tolist())
    if order is not None:
        found["order"] = tuple((np.searchsorted(np.sort(order), order) + 1).tolist())
    return found


def groups_differ(
    groups: tuple[Int[Array, " A"], Int[Array, " B"]], columns: Float[Array, "M D"], lengths: Int[Array, " M"]
) -> tuple[str, ...]:
    """A sentence about the facts in which the groups A and B clearly differ; `columns` as in an audit."""
    found, (first, second) = [], groups
    n, pairs = len(first) + len(second), len(first) * len(second)
    for name, (channel, sign, *words) in RANKS.items():
        values = sign * columns[:, CHANNELS.index(channel)]
        ranks = mean_ranks(values[np.concatenate([second, first])])[: len(second)]
        above = float(ranks.sum() - len(second) * (len(second) + 1) / 2) / pairs
        # By the normal approximation: to import scipy.stats takes as long as all else.
        p = 2 * ndtr(-abs(above - 0.5) / np.sqrt((n + 1) / (12 * pairs)))
        if p <= MAX_P and max(above, 1 - above) >= MIN_SEPARATION:
            of_b, of_a = (np.median(lengths[group]) for group in (second, first))
            steps = f" (median {of_b:,.0f} against {of_a:,.0f} steps)"
            found.append(words[above > 0.5] + steps * (name == "length"))
    differ = f"B {listed(found)}" if found else "in length, smoothness and path they hardly differ"
    return (f"{TWO_GROUPS}{differ}.",)
