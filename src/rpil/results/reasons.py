"""The reason for a verdict, as one sentence: the part of the evidence that decided, and the steps that stand out.

Steps stand out where they are much more likely under the reference, or the named adversary, than under the policy
of the trusted: the stretch of consecutive steps with the lowest sum of log-ratios.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import logit

from rpil.inference.answers import Answers
from rpil.numerics.types import Array, Float
from rpil.results.judged import Judged
from rpil.results.words import SIDES

MIN_STRETCH = 5.0
"""Nats against the policy of the trusted from which a stretch is named: a hundred and fifty to one. No verdict depends
on it."""

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


def reasons_of(audit: Judged, answers: Answers) -> Iterator[str]:
    """The reason for the verdict on each demonstration; the `answers` about one are about its copies too."""
    log_ratio = [audit.log_ratio(m) for m in range(len(audit.ids))]
    score = np.array([ratio.mean() for ratio in log_ratio])
    trusted = score[[SIDES[verdict] == "upper" for verdict in audit.verdicts]]
    trusted_score = float(np.median(trusted)) if len(trusted) else math.nan
    groups = {name: letter for letter, group in zip("AB", audit.competing, strict=False) for name in group}
    for m, name in enumerate(audit.ids):
        reason = _by_answers(audit, m, answers) or _by_finding(audit, groups.get(name, ""))
        reason = reason or _by_evidence(audit, m, float(score[m]), trusted_score)
        stretch = worst_stretch(log_ratio[m])
        if stretch is not None and audit.finding != "nothing could be learned":
            first, last = stretch.first, stretch.last
            subject = f"step {first} is" if first == last else f"steps {first} to {last} are"
            reason += f"; {subject} least like {audit.words.upper} ones ({stretch.nats:+.1f} nats)"
            reason += f": {audit.deviations[m]}" if audit.deviations and audit.deviations[m] else ""
        yield f"{reason}."


def _by_answers(audit: Judged, m: int, answers: Answers) -> str:
    """The reason by the label of demonstration `m`, or by what is learned from answers; or nothing."""
    verdict, words, nats = audit.verdicts[m], audit.words, f"{audit.log_odds[m]:+.1f} nats"
    if answers.labels[m]:
        again = ", which contradicts the other answers: look again" * (audit.ids[m] in audit.contradicting)
        return f"Labelled {'good' if answers.labels[m] > 0 else 'bad'}{again}"
    if audit.finding != "answered" or verdict == "open":
        return ""
    if verdict not in (words.upper, words.lower):
        return f"Called {verdict} without the answers, which do not contradict it"
    if math.isfinite(answers.outcome[m]):
        return f"Its outcome is among the {'highest' if verdict == words.upper else 'lowest'} ({nats})"
    return f"Judged by what the answers say of demonstrations like it ({nats})"


def _by_finding(audit: Judged, group: str) -> str:
    """The reason where the finding gives no demonstration a word, or nothing; `group` is A, B or nothing."""
    if audit.finding == "two groups":
        acts = f"It acts as group {group} does, and only" if group else "Only"
        return f"{acts} an answer can tell which group is good"
    if audit.finding == "in doubt":
        doubt = audit.doubts[0] if audit.doubts else ""
        return f"No word, because of a doubt: {doubt[:1].lower()}{doubt[1:].rstrip('.')}"
    why = {"nothing could be learned": "the state does not help to predict any actions"}
    why["nobody stands out"] = "all scores are one group"
    return f"Nothing tells it from the others: {why[audit.finding]}" if audit.finding in why else ""


def _by_evidence(audit: Judged, m: int, score: float, trusted_score: float) -> str:
    """The evidence with the largest part in the verdict on demonstration `m`, or why it has no word.

    `score` is the mean log-ratio of its steps, and `trusted_score` the median one of those with the upper word, NaN
    where there are none.
    """
    words, log_odds, side = audit.words, float(audit.log_odds[m]), SIDES[audit.verdicts[m]]
    if side == "open" and abs(log_odds) < logit(audit.settings.min_proba(audit.anchor)):
        return f"Its log-odds of {log_odds:+.1f} nats are too close to 0 to call it {words.upper} or {words.lower}"
    if side == "open":
        withheld = "that alone gives no word"
        if words.upper == "typical":
            better = "only the better half of those that score high is called typical, if "
            withheld = f"{better if log_odds > 0 else 'it is called unlike only if '}other folds agree"
        return f"Its log-odds are {log_odds:+.1f} nats, but {withheld}"
    sign = 1 if side == "upper" else -1
    if sign * audit.from_demonstrator[m] > sign * audit.from_actions[m]:
        others, actions = f"{audit.from_demonstrator[m]:+.1f} nats", f"{audit.from_actions[m]:+.1f} nats"
        return f"Judged by its demonstrator's other demonstrations ({others}; {actions} from its own actions)"
    is_lower = side == "lower" and score < trusted_score  # no score is below NaN
    trusted = f", that of the {words.upper} ones {trusted_score:+.2f}" if is_lower else ""
    return f"Judged by its actions: its mean log-ratio is {score:+.2f} nats{trusted}"
