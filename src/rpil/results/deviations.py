"""What a demonstration does in its worst steps, compared with what the policy of the trusted does there."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from rpil.data.spaces import Space
from rpil.inference.findings import DECIDED
from rpil.numerics.types import Array, Float, Int, Num
from rpil.results.reasons import MAX_LOG_RATIO, worst_stretch
from rpil.results.record import Audit
from rpil.results.text import printable
from rpil.results.words import SIDES

Outputs = Callable[[Int[Array, " R"]], Float[Array, "R O"]]
"""The outputs of the policy of the trusted in some of the steps: log-probabilities, or means."""

MAX_STEPS = 20
"""Steps of a stretch that are compared, those with the lowest log-ratios: enough to name an action."""

MIN_SHARE = 0.3
"""Share of these steps with one other action from which that action is named."""

MAX_TRUSTED_STEPS = 10_000
"""Steps that give the spread of the trusted around their policy."""


def deviations(
    audit: Audit,
    space: Space,
    classes: Array,
    actions: Num[Array, "N ..."],
    outputs: Outputs,
    action_names: Sequence[str] = (),
) -> tuple[str, ...]:
    """A phrase for each demonstration with a stretch of bad steps, and "" for all others, (M,).

    `actions` are codes of `classes`, or continuous with parts called `action_names`, if these have names. Without a
    trusted group there is nothing to compare with.
    """
    if audit.finding not in DECIDED or "upper" not in map(SIDES.get, audit.verdicts):
        return ()
    rows = [_worst_rows(audit, m) for m in range(len(audit.ids))]
    ends = np.cumsum([len(own) for own in rows])
    every = np.concatenate(rows)
    if not len(every):
        return ()
    expected = np.split(outputs(every), ends[:-1])
    if space.kind == "discrete":
        likely = (each.argmax(axis=1) for each in expected)
        return tuple(_other_action(classes[actions[r]], classes[k]) for r, k in zip(rows, likely, strict=True))
    trusted = np.flatnonzero(np.repeat([SIDES[v] == "upper" for v in audit.verdicts], audit.lengths))
    trusted = trusted[:: 1 + len(trusted) // MAX_TRUSTED_STEPS]
    # The median error, times what makes it the standard deviation of a normal distribution.
    spread = 1.4826 * np.median(np.abs(actions[trusted] - outputs(trusted)), axis=0)
    names = tuple(action_names) or tuple(map(str, range(len(spread))))
    return tuple(_far_part(actions[r] - mean, spread, names) for r, mean in zip(rows, expected, strict=True))


def _worst_rows(audit: Audit, index: int) -> Int[Array, " R"]:
    """The rows of the worst steps in the worst stretch of a demonstration."""
    log_ratio = np.clip(audit.step_log_ratio[audit.steps(index)], -MAX_LOG_RATIO, MAX_LOG_RATIO, dtype=float)
    stretch = worst_stretch(log_ratio)
    if stretch is None:
        return np.empty(0, dtype=np.int64)
    own = np.arange(stretch.first, stretch.last + 1)
    worst = own[np.argsort(log_ratio[own], kind="stable")[:MAX_STEPS]]
    return np.asarray(audit.offsets[index] + worst)


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


def _far_part(error: Float[Array, "R A"], spread: Float[Array, " A"], names: tuple[str, ...]) -> str:
    """The part of the action that is furthest from the mean of the trusted, in units of their spread.

    A part that is constant among the trusted, as a joint that is not used, is not compared.
    """
    if not len(error) or not (spread > 0).any():
        return ""
    size = np.median(np.abs(error), axis=0) / np.where(spread > 0, spread, np.inf)
    part = int(np.argmax(size))
    signs = np.sign(error[:, part])
    side = "too high" if (signs > 0).all() else "too low" if (signs < 0).all() else "off"
    name = "its action" if error.shape[1] == 1 else f"part {printable(names[part])} of its action"
    return f"{name} is {side} by {size[part]:.1f} times the spread of the trusted"
