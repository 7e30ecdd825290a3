"""The parts of a continuous action that the judge sees, and their scales.

A part that rests within nine in ten demonstrations, such as a parked arm, says nothing about who drives: where it rests
is the set-up of a session. Scales come from the motion within demonstrations, for the same reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.numerics.regression import robust_scale, scale_within
from rpil.numerics.types import Array, Bool, Float, Int, Num

MOST = 0.9
"""Share of the demonstrations within which a part rests that is not judged: that it moves in a few is evidence."""
MAX_SPREAD = 0.01
"""Standard deviation within the median demonstration up to which a part may rest, relative to the upper quartile of
the parts that change: several hundred times that of a parked arm, and half of the smallest one of parts that move."""
MAX_CHANGES = 0.5
"""Share of the steps of the median demonstration in which a part that rests may change: it trembles now and then."""
MAX_RANGE = 0.5
"""Range within the median demonstration, relative to the range within all, up to which a part may rest: a gripper
changes rarely, and in small units, but from end to end."""
MAX_DISTANCE = 100.0
"""Spreads from the location, by `rpil.numerics.regression.robust_scale`, at which actions are cut off: beyond what a
gripper does that most demonstrations hardly move."""
MIN_GAP = 2.5
"""Gap between resting values from which they are clearly different, relative to every other gap and to the motion
within the median demonstration."""
MAX_SESSIONS = 6
"""Groups of demonstrations with a resting value of their own, at most; more are no sessions."""


def judged_parts(actions: Num[Array, "N A"], offsets: Int[Array, " M1"]) -> Bool[Array, " A"]:
    """Which parts of the actions are judged: those that move within more than a tenth of the demonstrations, or all if
    none does."""
    episodes = np.split(np.asarray(actions, dtype=float), offsets[1:-1])
    spread = _of_most([episode.std(axis=0) for episode in episodes])
    extent = _of_most([np.ptp(episode, axis=0) for episode in episodes])
    changes = _of_most([(np.diff(episode, axis=0) != 0).sum(axis=0) / len(episode) for episode in episodes])
    typical = np.quantile(spread[extent > 0], 0.75) if (extent > 0).any() else 0.0
    still = (spread <= MAX_SPREAD * typical) & (changes < MAX_CHANGES) & (extent <= MAX_RANGE * np.ptp(actions, axis=0))
    rests = (extent == 0) | still
    return np.asarray(~rests | rests.all())


def _of_most(values: Sequence[Float[Array, " A"]]) -> Float[Array, " A"]:
    """What nine in ten demonstrations do not exceed."""
    return np.asarray(np.quantile(values, MOST, axis=0, method="lower"))


def resting_names(judged: Bool[Array, " A"], names: Sequence[str] = ()) -> str:
    """The names of the parts that are not judged; a prefix of names all of which rest is written once, with a star."""
    every = tuple(names) or tuple(map(str, range(len(judged))))
    moving = tuple(name for name, moves in zip(every, judged, strict=True) if moves)
    found: dict[str, None] = {}
    for name, moves in zip(every, judged, strict=True):
        if not moves:
            found[_folded(name, every, moving)] = None
    return ", ".join(found)


def _folded(name: str, every: Sequence[str], moving: Sequence[str]) -> str:
    """The shortest prefix of a `name`, up to a dot, that two or more names share and none of a part that moves."""
    dots = (k + 1 for k, letter in enumerate(name) if letter == ".")
    for prefix in (name[:end] for end in dots):
        shared = sum(other.startswith(prefix) for other in every) > 1
        if shared and not any(other.startswith(prefix) for other in moving):
            return f"{prefix}*"
    return name


def not_judged(judged: Bool[Array, " A"], names: Sequence[str] = ()) -> str:
    """A sentence that names the parts that are not judged; empty where all are."""
    n_parts, n_resting = len(judged), int((~judged).sum())
    if not n_resting:
        return ""
    return f"not judged: {n_resting} of {n_parts} parts of the action, which rest: {resting_names(judged, names)}"


def resting_sessions(
    actions: Num[Array, "N A"], offsets: Int[Array, " M1"], judged: Bool[Array, " A"]
) -> dict[int, list[Int[Array, " G"]]]:
    """Of each part that is not judged and rests at 2 to `MAX_SESSIONS` clearly different values: the demonstrations at
    each of them, two or more, lowest values first."""
    episodes = np.split(np.asarray(actions, dtype=float), offsets[1:-1])
    found = {}
    for part in np.flatnonzero(~judged):
        motion = float(np.median([episode[:, part].std() for episode in episodes]))
        groups = _divide_at_gaps(np.array([np.median(episode[:, part]) for episode in episodes]), motion)
        if groups:
            found[int(part)] = groups
    return found


def _divide_at_gaps(value: Float[Array, " M"], motion: float) -> list[Int[Array, " G"]]:
    """The most groups of two or more that gaps of `MIN_GAP` times all other gaps, and the `motion`, divide; or none."""
    order = np.argsort(value, kind="stable")
    gaps = np.diff(value[order])
    widest = np.argsort(-gaps, kind="stable")
    for n_cuts in range(min(MAX_SESSIONS, len(value) // 2) - 1, 0, -1):
        cuts, others = widest[:n_cuts], widest[n_cuts:]
        groups = np.split(order, np.sort(cuts) + 1)
        if gaps[cuts].min() > MIN_GAP * max(motion, *gaps[others]) and min(map(len, groups)) >= 2:
            return [np.sort(group) for group in groups]
    return []


@stored(location="A", spread="A", reach="A")
@dataclass(frozen=True, eq=False)
class ActionScale:
    """How the judge scales continuous actions."""

    location: Float[Array, " A"]
    spread: Float[Array, " A"]
    """The median, and the motion within demonstrations; infinite for a part that is not judged."""
    reach: Float[Array, " A"]
    """Distance from the location at which actions are cut off: least squares have no robustness of their own."""

    @classmethod
    def of(cls, data: FitData) -> ActionScale:
        """From the demonstrations of `data`."""
        location, around = robust_scale(data.actions, data.offsets)
        spread = scale_within(data.actions, data.offsets)[1]
        spread = spread if data.judged is None else np.where(data.judged, spread, np.inf)
        return cls(location, spread, MAX_DISTANCE * around)

    def __call__(self, actions: Num[Array, "N A"]) -> Float[Array, "N A"]:
        """Actions less their location, in spreads: 0 where a part is not judged."""
        return np.asarray(np.clip(actions - self.location, -self.reach, self.reach) / self.spread)

    def back(self, scaled: Float[Array, "N A"]) -> Float[Array, "N A"]:
        """Actions in the units of the data; the location where a part is not judged."""
        return np.asarray(self.location + scaled * np.where(np.isfinite(self.spread), self.spread, 0.0))


def session_sentence(name: str, groups: Sequence[Sequence[object]]) -> str:
    """A sentence about the sessions in which the part of this `name` rests elsewhere; the largest is "the others"."""
    smaller = sorted(groups, key=len)[:-1]
    named = "; ".join(", ".join(map(str, group)) for group in smaller)
    return f"{name} rests elsewhere in {named} than in the others: a session or a set-up."
