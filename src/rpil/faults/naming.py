"""Which fault, when undone, makes a demonstration fit the maps of the others: limits from a sample, then each block.

What undoing a fault gains in the demonstrations as they are tells from where on a gain is unusual. Power without
planting: the loss from undoing a fault in a clean demonstration equals the gain in one that has it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from rpil.faults import settings
from rpil.faults.lag import Pair
from rpil.faults.maps import FLOOR, OF_ROWS, Window, fit_maps, gains, levels, misfit, others, per_column
from rpil.faults.measured_columns import MovingBlock
from rpil.numerics.types import Array, Float

EXPLAINED = 2.0
"""Times what undoing a fault gains that may be unusual before: it explains at least half."""

CONSTANT = 1.1
"""The same of an offset, which explains nine tenths."""


@dataclass(frozen=True, eq=False)
class Level:
    """What the maps leave over of the means of demonstrations: its centre and variance, (K,), and from where on the
    sum of squares is unusual. A constant that is added to a column changes nothing else."""

    centre: Float[Array, " K"]
    variance: Float[Array, " K"]
    rest: float = np.inf

    @classmethod
    def of(cls, levels: Float[Array, "M K"]) -> Level:
        """From those of a sample."""
        centre = np.median(levels, axis=0)
        variance = np.median((levels - centre) ** 2, axis=0) / 0.455 + FLOOR
        plain = cls(centre, variance)
        return replace(plain, rest=float(_above(np.array([plain.excess(x) for x in levels]), settings.FENCE)))

    def excess(self, level: Float[Array, " K"]) -> float:
        return float(((level - self.centre) ** 2 / self.variance).sum() / 2)

    def gains(self, level: Float[Array, " K"], column: Float[Array, "K C"]) -> Float[Array, " C"]:
        """What taking the best constant off each column gains, with `per_column`."""
        along = column.T @ ((level - self.centre) / self.variance)
        return np.asarray(along**2 / (2.0 * self.power(column)))

    def power(self, column: Float[Array, "K C"]) -> Float[Array, " C"]:
        """Twice what a constant of one standard deviation gains."""
        return np.asarray((column**2 / self.variance[:, None]).sum(axis=0) + FLOOR)


@dataclass(frozen=True, eq=False)
class Namer:
    """What names the fault of a demonstration."""

    window: Window
    maps: Float[Array, "F K D"]
    """`fit_maps`."""
    usual: Float[Array, " K"]
    """Mean squares of what they leave over."""
    reach: Float[Array, "F C"]
    """Variances up to which the maps are known."""
    level: Level
    limit: Float[Array, " H"]
    """Gain from which a fault is named, NaN where nothing is known."""
    rest: float
    """What a demonstration leaves over beyond the usual, from which on that is unusual."""
    screen: float
    """The same, from which on faults other than offsets are tried."""

    def name(self, number: int, values: Float[Array, "T C"]) -> tuple[int, float]:
        """The fault tried that a demonstration has, and what undoing it gains; 0 where it has none."""
        maps, moments = self.maps[number % len(self.maps)], self.window.moments(values)
        if moments is None or self._is_far(moments, self.reach[number % len(self.maps)]):
            return 0, 0.0
        gain, n = np.zeros(len(self.limit)), len(self.limit) - len(self.window.column)
        excess = float(np.log(misfit(maps, moments) / self.usual).sum() / 2)
        if excess > self.screen:
            gain[:n] = gains(values, moments, maps, self.window)
            gain[:n] *= (gain[:n] > self.limit[:n]) & (excess - self.rest <= gain[:n] * EXPLAINED)
        if not gain.any() and excess <= self.rest:  # an offset changes the level alone
            level = levels(values, maps, self.window)
            off = self.level.gains(level, per_column(maps, self.window))
            gain[n:] = off * ((off > self.limit[n:]) & (self.level.excess(level) - self.level.rest <= off * CONSTANT))
        best = int(np.argmax(gain))
        return best, float(gain[best])

    def _is_far(self, moments: Float[Array, "D D"], reach: Float[Array, " C"]) -> bool:
        """Whether a column moves farther than where the maps are known."""
        return bool((moments.diagonal()[self.window.places[:, 1]] * self.window.spread**2 > reach).any())


def learn_maps(
    sample: MovingBlock, pairs: tuple[Pair, ...], most_related: tuple[Array, Array], n_all: int
) -> Namer | None:
    """The maps of a sample, and the limits of the gains in it; None where no map tells anything. See `find_lag`."""
    numbers, offsets = sample.numbers, sample.offsets
    action, state = (chosen[: settings.MAP_COLUMNS] for chosen in most_related)
    if not len(action) or not len(state) or len(numbers) < settings.FEWEST_DEMONSTRATIONS:
        return None
    own = np.concatenate([np.sort(state), np.sort(action)])
    values = sample.values[own]
    rows = [values[:, a:b].T for a, b in itertools.pairwise(offsets)]
    centre, spread = np.median(values, axis=1), values.std(axis=1)
    found = []
    for steps in dict.fromkeys([0, 1, 2, *[pair.lag for pair in pairs[:1]]]):
        window = Window(own, len(state), steps, centre, spread, settings.MAP_ROWS)
        namer = _namer(rows, numbers, window, n_all)
        found += [] if namer is None else [namer]
    return max(found, key=lambda pair: pair[0])[1] if found else None


def _namer(rows: list[Array], numbers: Array, window: Window, n_all: int) -> tuple[float, Namer] | None:
    """How much faults of all columns would be seen with a window, and what names them; None where no map tells
    anything."""
    seen = [window.moments(x) for x in rows]
    kept = [m for m, g in enumerate(seen) if g is not None]
    if len(kept) < settings.FEWEST_DEMONSTRATIONS:
        return None
    fold, moments = numbers[kept] % settings.MAP_FOLDS, np.stack([g for g in seen if g is not None])
    maps = fit_maps(moments, fold, window)
    if not maps.any():
        return None
    left = np.log([misfit(maps[f], g) for f, g in zip(fold, moments, strict=True)])
    usual = np.median(left, axis=0)
    excess = (left - usual).sum(axis=1) / 2
    share = max(1.0 - settings.PILOT_DEMONSTRATIONS / n_all, 0.0)
    some = np.unique(np.linspace(0, len(kept) - 1, settings.MAP_SAMPLE).astype(int))
    gain = np.array([gains(rows[kept[k]], moments[k], maps[fold[k]], window) for k in some])
    offs = np.array([levels(rows[m], maps[f], window) for m, f in zip(kept, fold, strict=True)])
    level, column = Level.of(offs), per_column(maps, window)
    off = np.array([level.gains(x, column[f]) for x, f in zip(offs, fold, strict=True)])
    rest, screen = float(_above(excess, settings.FENCE)), float(np.quantile(excess, share)) if share else -np.inf
    limit = np.maximum(_above(gain, settings.TAIL), settings.LEAST_GAIN)
    middle = window.places[:, 1]
    means = np.array([moments[others(fold, f)].mean(axis=0)[middle, middle] for f in range(len(maps))])
    reach = settings.MAP_REACH * means * window.spread**2
    limit = np.append(limit, np.maximum(4.0 * np.quantile(off, 0.9, axis=0), settings.OFFSET_GAIN))
    usual_ones = excess[some] <= np.quantile(excess, settings.MAP_POWER)
    power = np.append(_planted(gain[usual_ones]), settings.LEAST_OFFSET**2 / 2 * level.power(column[0]))
    known = np.where(power > limit, limit, np.nan)
    apart = float(-np.median(gain, axis=0)[len(window.column) :].sum())
    return apart, Namer(window, maps, np.exp(usual), reach, level, known, rest, screen)


def _planted(gain: Float[Array, "M H"]) -> Float[Array, " H"]:
    """What undoing each fault would gain at least in most demonstrations: what making it loses."""
    lost, n, rows = -np.quantile(gain, settings.MAP_POWER, axis=0), gain.shape[1] - len(OF_ROWS), list(OF_ROWS)
    return np.append(lost[:n], [lost[n + rows.index(opposite)] for opposite in OF_ROWS.values()])


def _above(values: Array, tail: float) -> Array:
    """From where on values of demonstrations are unusual, above most of them."""
    middle, high = np.quantile(values, [0.5, 0.75], axis=0)
    return np.asarray(high + tail * (high - middle))
