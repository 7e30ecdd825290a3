"""Sentences about parts of the action that rest, which are not judged, and about sessions by where these rest."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from rpil.data.fit_data import FitData
from rpil.numerics.types import Array, Bool, Float, Int, Num

MIN_GAP = 2.5
"""Gap between resting values from which they are clearly different, relative to every other gap and to the motion
within the median demonstration."""
MAX_SESSIONS = 6
"""Groups of demonstrations with a resting value of their own, at most; more are no sessions."""


def resting_sentences(data: FitData, ids: Sequence[Hashable], names: Sequence[str]) -> tuple[str, ...]:
    """The parts that are not judged, and the demonstrations, by their `ids`, in which one of them rests elsewhere;
    `names` are those of the parts, or none."""
    if data.judged is None or data.judged.all():
        return ()
    names = tuple(names) or tuple(map(str, range(len(data.judged))))
    sentence = not_judged(data.judged, names)
    sessions = resting_sessions(data.actions, data.offsets, data.judged)
    return f"{sentence[:1].upper()}{sentence[1:]}.", *(
        session_sentence(names[part], [[ids[m] for m in group] for group in groups])
        for part, groups in sessions.items()
    )


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


def session_sentence(name: str, groups: Sequence[Sequence[object]]) -> str:
    """A sentence about the sessions in which the part of this `name` rests elsewhere; the largest is "the others"."""
    smaller = sorted(groups, key=len)[:-1]
    named = "; ".join(", ".join(map(str, group)) for group in smaller)
    return f"{name} rests elsewhere in {named} than in the others: a session or a set-up."
