"""Places that leaving demonstrations out would lose: those that none of the kept ones visits.

Where a demonstration is left out, the policy never sees its states. That is no loss where kept demonstrations visit the
same places, and one where it alone starts behind the object.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Sequence
from itertools import compress

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import stdtrit

from rpil.data.demonstrations import Demonstrations
from rpil.data.memory import TooLargeError
from rpil.data.text import listed, printable
from rpil.formats.format import Dataset
from rpil.numerics.regression import ROUNDING, robust_scale
from rpil.numerics.types import Array, Bool, Float, Num

MAX_STATES = 5000
"""States of the kept demonstrations that are compared, and of the others."""

SAME_PLACE, TIMES_FARTHER = 0.1, 2.0
"""Spreads up to which two states are the same place; than the farthest of the kept ones, as tails may be heavy."""

FALSE_ALARMS = 0.01
"""Probability of any sentence where all demonstrations are alike."""

MIN_KEPT = 3
"""Demonstrations whose distances from one another say what is usual, at least."""


def lost_places(demonstrations: Demonstrations | Dataset, kept: Collection[object]) -> tuple[str, ...]:
    """A sentence for each place that only demonstrations visit whose ids are not `kept`, most often none, such as "No
    kept demonstration starts with obs.3 above 0.41; 12 does." Of data that do not fit in memory, or whose observations
    are not finite, nothing is said.

    For each demonstration that is left out the distance of its start to the nearest start of a kept one is compared
    with what is usual among the kept ones, each left out in turn; and so is the median distance of its states.
    """
    names = {*map(str, kept)}
    is_kept = np.array([str(name) in names for name in demonstrations.ids])
    if is_kept.sum() < MIN_KEPT or is_kept.all():
        return ()
    if isinstance(demonstrations, Dataset):
        try:
            demonstrations = demonstrations.select(slice(None))
        except TooLargeError:
            return ()
    if not demonstrations.observations.size or not np.isfinite(demonstrations.observations).all():
        return ()
    episodes, chosen = [own for own, _ in demonstrations], [_thin(np.flatnonzero(is_kept == one)) for one in (1, 0)]
    some = [_thin(episodes[m], MAX_STATES // len(own)) for own in chosen for m in own.tolist()]
    members, of_kept = np.concatenate(chosen), np.repeat([True, False], [*map(len, chosen)])
    scale = robust_scale(np.concatenate(some), np.cumsum([0, *map(len, some)]))[1]
    starts, known, sentences = [own[:1] for own in episodes], np.zeros(len(members), dtype=bool), list[str]()
    for verb, near, visited, states in (
        ("starts with", "starts near the start", starts, [starts[m] for m in members.tolist()]),
        ("reaches", "comes near half of the states", episodes, some),
    ):
        far = _far([own / scale for own in states], of_kept) & ~known
        known |= far
        reached, who = np.concatenate([*compress(visited, is_kept)]), defaultdict[str, list[object]](list)
        for m in members[far].tolist():
            who[_outside(visited[m], reached, scale, demonstrations.observation_names)].append(demonstrations.ids[m])
        for where, ids in who.items():
            does = f"{verb} {where}; {listed(ids)} do{'es' * (len(ids) == 1)}" if where else f"{near} of {listed(ids)}"
            sentences.append(f"No kept demonstration {does}.")
    return tuple(sentences)


def _thin(values: Num[Array, "R ..."], most: int = MAX_STATES) -> Num[Array, "S ..."]:
    """At most so many of the values, evenly spaced."""
    return values[:: -(-len(values) // most)]


def _far(states: Sequence[Float[Array, "_ D"]], is_kept: Bool[Array, " C"]) -> Bool[Array, " C"]:
    """Which of the demonstrations that are not kept are farther from the kept ones than these from one another: twice
    the largest distance, and above the 99 % point of the next one that is alike, were logarithms normal."""
    distance, owner = np.zeros(len(is_kept)), np.repeat(np.arange(len(is_kept)), [*map(len, states)])
    every, of_kept = np.concatenate(states), is_kept[owner]
    for m, own in enumerate(states):
        distance[m] = np.median(cdist(own, every[of_kept & (owner != m)]).min(axis=1))
    size, n = np.log(np.maximum(distance[is_kept], ROUNDING)), int(is_kept.sum())
    level = FALSE_ALARMS / (2 * (~is_kept).sum())  # starts and states of each are compared
    limit = size.mean() + stdtrit(n - 1, 1 - level) * size.std(ddof=1) * np.sqrt(1 + 1 / n)
    return np.asarray(~is_kept & (distance > max(np.exp(limit), TIMES_FARTHER * distance[is_kept].max(), SAME_PLACE)))


def _outside(states: Num[Array, "R D"], reached: Num[Array, "K D"], scale: Array, names: Sequence[str]) -> str:
    """The observation in which states are farthest outside of what was `reached`, with a bound, or nothing; the bound
    has the digits that tell both apart, and no state that was reached passes it."""
    (low, high), (least, most) = ((values.min(axis=0), values.max(axis=0)) for values in (reached, states))
    beyond = np.array([low - least, most - high], dtype=float) / scale
    side, column = divmod(int(beyond.argmax()), len(names))
    bound, gap, name = float((low, high)[side][column]), float((beyond * scale)[side, column]), names[column]
    if gap <= 0:
        return ""
    digits = max(0, 2 - math.floor(math.log10(gap)))
    outwards = (math.floor, math.ceil)[side](bound * 10**digits) / 10**digits
    where = f"observation {name}" if name.isdigit() else printable(name)
    return f"{where} {('below', 'above')[side]} {outwards:.{digits}f}"
