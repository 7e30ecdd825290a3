"""What a demonstration does in its worst steps, compared with what the trusted do there."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from rpil.data.text import printable
from rpil.inference.contrast import evidence_by_part
from rpil.inference.findings import DECIDED
from rpil.numerics.types import Array, Int
from rpil.results.evidence import PolicyOutputs, StepEvidence, part_name
from rpil.results.reasons import worst_stretch
from rpil.results.record import Audit
from rpil.results.words import SIDES

MAX_STEPS = 20
"""Steps of a stretch that are compared, those with the lowest log-ratios: enough to name an action."""

MIN_SHARE = 0.3
"""Share of these steps with one other action from which that action is named."""


def deviations(audit: Audit, evidence: StepEvidence, classes: Array, outputs: PolicyOutputs) -> tuple[str, ...]:
    """A phrase for each demonstration with a stretch of bad steps, and "" for all others, (M,).

    Discrete actions are codes of `classes`, beside the most likely ones by the `outputs`. Of continuous actions it is
    the part with most of the evidence in these steps, beside what the typical do, in the units of the data. Without a
    trusted group there is nothing to compare with.
    """
    if audit.finding not in DECIDED or "upper" not in map(SIDES.get, audit.verdicts):
        return ()
    phrases, data = [], evidence.data
    for m, place in enumerate(np.searchsorted(evidence.members, audit.copy_of).tolist()):
        steps = _worst_steps(audit, m)
        rows = data.offsets[place] + steps
        if not len(steps):
            phrases.append("")
        elif data.space.kind == "continuous":
            phrases.append(_far_part(evidence, rows, steps))
        else:
            likely = outputs(audit.offsets[m] + steps).argmax(axis=1)
            phrases.append(_other_action(classes[data.actions[rows]], classes[likely]))
    return tuple(phrases)


def _worst_steps(audit: Audit, index: int) -> Int[Array, " R"]:
    """The worst steps in the worst stretch of a demonstration."""
    log_ratio = audit.log_ratio(index)
    stretch = worst_stretch(log_ratio)
    if stretch is None:
        return np.empty(0, dtype=np.int64)
    own = np.arange(stretch.first, stretch.last + 1)
    return np.asarray(own[np.argsort(log_ratio[own], kind="stable")[:MAX_STEPS]])


def _other_action(taken: Array, likely: Array) -> str:
    """The most frequent pair of an action taken, and another that the trusted most likely take."""
    pairs = Counter(pair for pair in zip(taken.tolist(), likely.tolist(), strict=True) if pair[0] != pair[1])
    if not pairs:
        return ""
    (own, other), count = pairs.most_common(1)[0]
    if count < MIN_SHARE * len(taken):
        return ""
    compared = f"it takes action {printable(own)} where the trusted most likely take {printable(other)}"
    return f"{compared} ({count} of its {len(taken)} worst steps)"


def _far_part(evidence: StepEvidence, rows: Int[Array, " R"], steps: Int[Array, " R"]) -> str:
    """The part of the action with most of the evidence in these steps, in that step of them in which it leaves the band
    of the typical by the median distance; "" where it does not."""
    parts = evidence_by_part(evidence.nats[rows].sum(axis=0))
    if not parts:
        return ""
    j, share = parts[0]
    value, low, high = (each[rows, j] for each in (evidence.value, evidence.low, evidence.high))
    away = np.maximum(low - value, value - high)
    own = int(np.argsort(away, kind="stable")[len(away) // 2])
    if away[own] <= 0:
        return ""
    is_at, first, last = _digits(value[own], low[own], high[own])
    band = first if first == last else f"{first} to {last}"
    part = f" ({share:.0%} of the evidence there)" * (evidence.nats.shape[1] > 1)
    its = f"at step {steps[own]} its {part_name(evidence.data, j)} is at {is_at}"
    return f"{its} where the {evidence.compared_with} are at {band}{part}"


def _digits(value: float, low: float, high: float) -> tuple[str, ...]:
    """A value outside a band and both ends of the band, with the digits that tell them apart."""
    differences = [size for size in (high - low, max(low - value, value - high)) if size > 0]
    decimals = max(0, -math.floor(math.log10(min(differences))))
    return tuple(f"{round(number, decimals) + 0.0:.{decimals}f}" for number in (value, low, high))  # no minus zero
