"""What a demonstration does in its worst steps, compared with what the trusted do there."""

from __future__ import annotations

import math
from collections import Counter
from functools import partial
from itertools import starmap

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
    worst = [_worst_steps(audit, m) for m in range(len(audit.ids))]
    place = np.searchsorted(evidence.members, audit.copy_of)
    rows = [evidence.data.offsets[k] + steps for k, steps in zip(place, worst, strict=True)]
    if evidence.data.space.kind == "continuous":
        return tuple(starmap(partial(_far_part, evidence), zip(rows, worst, strict=True)))
    every = np.concatenate([audit.offsets[m] + steps for m, steps in enumerate(worst)])
    if not len(every):
        return ()
    expected = np.split(outputs(every), np.cumsum([len(steps) for steps in worst])[:-1])
    likely = (classes[each.argmax(axis=1)] for each in expected)
    return tuple(map(_other_action, (classes[evidence.data.actions[own]] for own in rows), likely))


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
    if not len(rows):
        return ""
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
