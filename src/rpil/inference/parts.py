"""The parts of a continuous action that the judge sees, and their scales.

A part that rests within nine in ten demonstrations, such as a parked arm, says nothing about who drives: where it rests
is the set-up of a session. Scales come from the motion within demonstrations, for the same reason.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from rpil.data.fit_data import FitData
from rpil.numerics.regression import robust_scale, spread_within
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


def judged_parts(actions: Num[Array, "N A"], offsets: Int[Array, " M1"]) -> Bool[Array, " A"]:
    """Which parts of the actions are judged: those that move within more than a tenth of the demonstrations, or all if
    none does."""
    episodes = np.split(np.asarray(actions, dtype=float), offsets[1:-1])
    spreads = [episode.std(axis=0) for episode in episodes]
    extents = [np.ptp(episode, axis=0) for episode in episodes]
    changes = [(np.diff(episode, axis=0) != 0).sum(axis=0) / len(episode) for episode in episodes]
    # What nine in ten demonstrations do not exceed.
    spread, extent, change = (np.quantile(each, MOST, axis=0, method="lower") for each in (spreads, extents, changes))
    typical = np.quantile(spread[extent > 0], 0.75) if (extent > 0).any() else 0.0
    still = (spread <= MAX_SPREAD * typical) & (change < MAX_CHANGES) & (extent <= MAX_RANGE * np.ptp(actions, axis=0))
    rests = (extent == 0) | still
    return np.asarray(~rests | rests.all())


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
        """From the demonstrations of `data`, measured once."""
        if (known := _SCALES.get(data)) is None:
            location, around = robust_scale(data.actions, data.offsets)
            spread = spread_within(data.actions, data.offsets)
            spread = spread if data.judged is None else np.where(data.judged, spread, np.inf)
            known = _SCALES[data] = cls(location, spread, MAX_DISTANCE * around)
        return known

    def __call__(self, actions: Num[Array, "N A"]) -> Float[Array, "N A"]:
        """Actions less their location, in spreads: 0 where a part is not judged."""
        scaled = np.clip(actions - self.location, -self.reach, self.reach)
        return np.asarray(np.divide(scaled, self.spread, out=scaled))

    def back(self, scaled: Float[Array, "N A"]) -> Float[Array, "N A"]:
        """Actions in the units of the data; the location where a part is not judged."""
        return np.asarray(self.location + scaled * np.where(np.isfinite(self.spread), self.spread, 0.0))


_SCALES = WeakKeyDictionary[FitData, ActionScale]()
