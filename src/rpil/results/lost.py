"""Places that leaving demonstrations out would lose: those that none of the kept ones visits.

Where a demonstration is left out, the policy never sees its states. That is no loss where kept demonstrations visit the
same places, and one where it alone starts behind the object. Both its start and its states are compared with those of
the kept ones: by the distance to the nearest, in spreads of the observations.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from itertools import compress

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import stdtrit

from rpil.data.demonstrations import Demonstrations
from rpil.data.text import listed, printable
from rpil.formats.dataset import Dataset
from rpil.numerics.regression import ROUNDING, robust_scale
from rpil.numerics.types import Array, Bool, Float, Num

MAX_STATES = 5000
"""States of the kept demonstrations that are compared, and of the others."""

SAME_PLACE = 0.1
"""Spreads up to which two states are the same place."""

TIMES_FARTHER = 2.0
"""Than the farthest of the kept ones a demonstration must be, because tails of distances may be heavy."""

FALSE_ALARMS = 0.01
"""Probability of any sentence where all demonstrations are alike."""

MIN_KEPT = 3
"""Demonstrations whose distances from one another say what is usual, at least."""

DIGITS = 3
"""Digits of a bound, unless more are needed to tell it from the demonstration that is beyond it."""


def lost_places(demonstrations: Demonstrations | Dataset, kept: Collection[object]) -> tuple[str, ...]:
    """A sentence for each place that only demonstrations visit whose ids are not `kept`, most often none, such as "No
    kept demonstration starts with obs.3 above 0.41; 12 does.", with the observation in which it is farthest outside of
    what the kept ones reach. Of data on disk, and without observations that are finite, nothing is said.

    For each demonstration that is left out the distance of its start to the nearest start of a kept one is compared
    with what is usual among the kept ones, each left out in turn; and so is the median distance of its states to the
    nearest state. A distance counts if it is twice the largest of theirs, and larger than the 99 % point of the next
    one that is alike, were logarithms normal; the level is shared among all that are left out.
    """
    if not isinstance(demonstrations, Demonstrations):
        return ()
    names = {str(name) for name in kept}
    is_kept = np.array([str(name) in names for name in demonstrations.ids])
    observed = demonstrations.observations
    if is_kept.sum() < MIN_KEPT or is_kept.all() or not observed.shape[1] or not np.isfinite(observed).all():
        return ()
    chosen = np.concatenate([_thin(np.flatnonzero(is_kept == side), MAX_STATES) for side in (True, False)])
    of_kept = is_kept[chosen]
    most = np.where(of_kept, MAX_STATES // of_kept.sum(), MAX_STATES // (~of_kept).sum()).tolist()
    episodes = [episode[0] for episode in demonstrations]
    starts, some = [own[:1] for own in episodes], [_thin(episodes[m], n) for m, n in zip(chosen, most, strict=True)]
    scale = robust_scale(np.concatenate(some), np.cumsum([0, *map(len, some)]))[1]
    far_start = _far([starts[m] / scale for m in chosen], of_kept)
    far_states = _far([states / scale for states in some], of_kept) & ~far_start
    lost: dict[tuple[str, str], list[object]] = defaultdict(list)
    for verb, far, visited in (("starts with", far_start, starts), ("reaches", far_states, episodes)):
        states = np.concatenate([*compress(visited, is_kept)])
        reached = states.min(axis=0), states.max(axis=0)
        for m in chosen[far].tolist():
            where = _outside(visited[m], reached, scale, demonstrations.observation_names)
            lost[verb, where].append(demonstrations.ids[m])
    return tuple(_sentence(verb, where, who) for (verb, where), who in lost.items())


def _sentence(verb: str, where: str, who: Sequence[object]) -> str:
    """Sentence on what no kept demonstration does, and who does; without a `where`, near what it does not come."""
    if where:
        return f"No kept demonstration {verb} {where}; {listed(who)} {'do' if len(who) > 1 else 'does'}."
    near = {"starts with": "starts near the start", "reaches": "comes near half of the states"}[verb]
    return f"No kept demonstration {near} of {listed(who)}."


def _thin(values: Num[Array, "R ..."], most: int) -> Num[Array, "S ..."]:
    """At most so many of the values, evenly spaced."""
    places = np.linspace(0, len(values) - 1, min(most, len(values))).round().astype(int)
    return np.asarray(values[np.unique(places)])


def _far(states: Sequence[Float[Array, "_ D"]], is_kept: Bool[Array, " C"]) -> Bool[Array, " C"]:
    """Which of the demonstrations that are not kept are farther from the kept ones than these from one another."""
    distance, owner = np.zeros(len(is_kept)), np.repeat(np.arange(len(is_kept)), [*map(len, states)])
    every, of_kept = np.concatenate(states), is_kept[owner]
    for m, own in enumerate(states):
        distance[m] = np.median(cdist(own, every[of_kept & (owner != m)]).min(axis=1))
    size = np.log(np.maximum(distance, ROUNDING))
    usual, n = size[is_kept], int(is_kept.sum())
    level = FALSE_ALARMS / (2 * (~is_kept).sum())  # starts and states of each are compared
    limit = usual.mean() + stdtrit(n - 1, 1 - level) * usual.std(ddof=1) * np.sqrt(1 + 1 / n)
    return np.asarray(~is_kept & (distance > max(np.exp(limit), TIMES_FARTHER * distance[is_kept].max(), SAME_PLACE)))


def _outside(
    states: Num[Array, "R D"], reached: tuple[Array, Array], scale: Float[Array, " D"], names: Sequence[str]
) -> str:
    """The observation in which states are farthest outside of what the kept ones reach, and its bound, which no kept
    one passes and some of the states do; or nothing."""
    low, high = reached
    beyond = np.array([np.maximum(low - states, 0).mean(axis=0), np.maximum(states - high, 0).mean(axis=0)]) / scale
    side, column = divmod(int(beyond.argmax()), beyond.shape[1])
    if not beyond[side, column]:
        return ""
    name = f"observation {names[column]}" if names[column].isdigit() else printable(names[column])
    bound, farthest = float((low, high)[side][column]), float((states.min(axis=0), states.max(axis=0))[side][column])
    return f"{name} {('below', 'above')[side]} {_outwards(bound, farthest)}"


def _outwards(bound: float, farthest: float) -> str:
    """The bound with few digits, rounded towards the value `farthest`, which it does not reach."""
    rounding = ROUND_CEILING if farthest > bound else ROUND_FLOOR
    for digits in range(DIGITS, 17):
        rounded = float(Context(prec=digits, rounding=rounding).create_decimal(Decimal(bound)))
        if (rounded - farthest) * (bound - farthest) > 0:
            return f"{rounded:.{max(digits, 12)}g}"
    return repr(bound)
