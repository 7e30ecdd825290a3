"""Sentences about parts of the action that rest, which are not judged, and about sessions by where these rest."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence

import numpy as np

from rpil.data.fit_data import FitData
from rpil.numerics.types import Array, Float, Int

MIN_GAP = 2.5
"""Gap between resting values from which they are clearly different, relative to every other gap and to the motion
within the median demonstration."""
MAX_SESSIONS = 6
"""Groups of demonstrations with a resting value of their own, at most; more are no sessions."""


def resting_sentences(data: FitData, ids: Sequence[Hashable]) -> Iterator[str]:
    """The parts that are not judged, and the demonstrations, by their `ids`, in which one of them rests elsewhere.

    A prefix of names all of which rest is written once, with a star.
    """
    if data.judged is None or data.judged.all():
        return
    names, resting = [*map(data.action_name, range(len(data.judged)))], np.flatnonzero(~data.judged).tolist()
    moving = [names[j] for j in np.flatnonzero(data.judged).tolist()]
    starred = dict.fromkeys(_starred(names[j], names, moving) for j in resting)
    yield f"Not judged: {len(resting)} of {len(names)} parts of the action, which rest: {', '.join(starred)}."
    for j in resting:
        episodes = np.split(np.asarray(data.actions[:, j], dtype=float), data.offsets[1:-1])
        motion = float(np.median([episode.std() for episode in episodes]))
        sessions = sorted(_divide_at_gaps(np.array([np.median(episode) for episode in episodes]), motion), key=len)
        if sessions:
            members = "; ".join(", ".join(str(ids[m]) for m in session) for session in sessions[:-1])
            yield f"{names[j]} rests elsewhere in {members} than in the others: a session or a set-up."


def _starred(name: str, names: Sequence[str], moving: Sequence[str]) -> str:
    """The shortest prefix of a `name`, up to a dot, that two or more `names` share and none of a part that moves."""
    for prefix in (name[: k + 1] for k, letter in enumerate(name) if letter == "."):
        is_shared = sum(other.startswith(prefix) for other in names) > 1
        if is_shared and not any(other.startswith(prefix) for other in moving):
            return f"{prefix}*"
    return name


def _divide_at_gaps(value: Float[Array, " M"], motion: float) -> list[Int[Array, " G"]]:
    """The most groups of two or more that gaps of `MIN_GAP` times all other gaps, and the `motion`, divide; or none.
    Lowest values first."""
    order = np.argsort(value, kind="stable")
    gaps = np.diff(value[order])
    widest = np.argsort(-gaps, kind="stable")
    for n_cuts in range(min(MAX_SESSIONS, len(value) // 2) - 1, 0, -1):
        cuts, others = widest[:n_cuts], widest[n_cuts:]
        groups = np.split(order, np.sort(cuts) + 1)
        if gaps[cuts].min() > MIN_GAP * max(motion, *gaps[others]) and min(map(len, groups)) >= 2:
            return [np.sort(group) for group in groups]
    return []
